// Gamepads in the browser: the axes of the pad whose dead-man is held; any pad may stop.
//
// Which button is which is known of a standard pad alone. Any other pad cannot drive; each of its buttons stops. A pad
// whose radio is out of reach keeps its last state, so only a change is a sign of a hand. Its `timestamp` is none:
// Chromium renews it at every look at a pad of Windows or macOS, also when nothing has come from the pad.

import { DEAD } from "./hand.js"

const APPEARS = 500  // ms in which a press is not fresh: the first report of a pad may come late
const DEAD_MAN = 0, STOP = 1, ARM = 9, TRIGGER = 7  // buttons of a standard gamepad: A, B, start, right trigger

export class Gamepads {
  #pads = new Map()  // of each by its place: the buttons that are down, all that it tells, and when it appeared

  // `hold`; what is called: `stop`, `arm` with whether its button is down, and `strange` with the name of a pad that
  // cannot drive
  constructor(hold, called) {
    this.hold = hold
    this.called = called
    // one that comes back is a new one, however soon
    for (const kind of ["gamepadconnected", "gamepaddisconnected"]) {
      addEventListener(kind, (event) => this.#gone(event.gamepad.index))
    }
  }

  look(now) {
    const there = [...(navigator.getGamepads?.() ?? [])]
    there.forEach((pad, index) => (pad?.connected ? this.#look(pad, index, now) : this.#gone(index)))
    for (const index of this.#pads.keys()) if (index >= there.length) this.#gone(index)
  }

  // Both axes of the pad that holds, ahead and left positive.
  get axes() {
    const { buttons, axes } = navigator.getGamepads()[this.hold.by.split(" ")[1]]
    const pull = buttons[TRIGGER]?.value ?? 0
    return { ahead: pull > DEAD ? pull : -axes[1], left: -axes[0] }
  }

  #gone(index) {
    if (this.#pads.get(index)?.down.has(ARM)) this.called.arm(false)
    this.#pads.delete(index)
    if (this.hold.by === `gamepad ${index}`) this.hold.end()
  }

  #look(pad, index, now) {
    const by = `gamepad ${index}`, standard = pad.mapping === "standard"
    const down = new Set(pad.buttons.flatMap((button, number) => (button.pressed ? [number] : [])))
    const told = [...pad.axes, ...pad.buttons.map((button) => button.value)].join()
    if (!this.#pads.has(index) && !standard) this.called.strange(pad.id)
    const before = this.#pads.get(index) ?? { down, told, since: now }
    this.#pads.set(index, { down, told, since: before.since })
    const pressed = (number) => down.has(number) && !before.down.has(number)
    const released = (number) => before.down.has(number) && !down.has(number)
    if (standard ? pressed(STOP) : [...down].some(pressed)) this.called.stop()
    if (!standard || now - before.since < APPEARS) return
    if (pressed(ARM) || released(ARM)) this.called.arm(down.has(ARM))
    if (released(DEAD_MAN)) this.hold.end()
    if (pressed(DEAD_MAN) && document.hasFocus() && !document.hidden) this.hold.press(by, now)
    else if (told !== before.told) this.hold.sign(by, now)
  }
}
