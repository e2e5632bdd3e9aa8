// A standard gamepad in the browser: its axes while the dead-man is held, and its two buttons for stop and arm.

import { shaped } from "./hand.js"

const HOLD = 500  // ms that arming takes
const DEAD_MAN = 0, STOP = 1, ARM = 9, TRIGGER = 7  // buttons of a standard gamepad: A, B, start, right trigger

export class Gamepad {
  ready = false  // the dead-man has been up since the page let go
  #stopped = false
  #arming = 0

  constructor({ stop, arm }) {
    this.stop = stop
    this.arm = arm
  }

  // Both axes, ahead and left positive; null where nothing is held.
  look() {
    const pad = [...(navigator.getGamepads?.() ?? [])].find((each) => each?.connected && each.mapping === "standard")
    if (!pad || document.hidden || !document.hasFocus()) {
      this.ready = false
      return null
    }
    const pressed = (button) => pad.buttons[button]?.pressed ?? false
    if (pressed(STOP) && !this.#stopped) this.stop()
    this.#stopped = pressed(STOP)
    if (pressed(ARM)) this.#arming ||= performance.now()
    else this.#arming = 0
    if (this.#arming > 0 && performance.now() - this.#arming >= HOLD) {
      this.#arming = -1  // once
      this.arm()
    }
    if (!pressed(DEAD_MAN)) {
      this.ready = true
      return null
    }
    if (!this.ready) return null
    const pull = shaped(pad.buttons[TRIGGER]?.value ?? 0)
    return { ahead: pull || shaped(-pad.axes[1]), left: shaped(-pad.axes[0]) }
  }
}
