// The driving keys. A key is what it is called when it goes down (`event.key`), and stays the same key by its place on
// the keyboard (`event.code`): with Option, Shift or another layout it goes up under another name.

import { swallowed, typing } from "./hold.js"

const MOVES = { w: "w", a: "a", s: "s", d: "d", arrowup: "w", arrowleft: "a", arrowdown: "s", arrowright: "d" }
// Shift is none of them: it only changes letters, its keys go up like all others, and + needs it on many keyboards.
const MODIFIERS = ["Control", "Alt", "AltGraph", "Meta", "OS", "Super", "Hyper", "Fn"]

export class Keys {
  #down = new Set()  // places of the keys that hold
  #known = new Map()  // the last name and move of each place
  #arm = ""  // place of the key that arms

  // `hold`; what is called: `moved` when the keys that hold are others, `stop`, `arm` with whether its key is down, and
  // `speed` with its change, m/s
  constructor(hold, called) {
    this.hold = hold
    this.called = called
    addEventListener("keydown", (event) => this.#pressed(event))
    addEventListener("keyup", (event) => this.#released(event))
    swallowed(() => this.#end())
  }

  // Both axes, each -1, 0 or 1: ahead, and left.
  get axes() {
    const moves = [...this.#down].map((code) => this.#known.get(code).move)
    const has = (move) => (moves.includes(move) ? 1 : 0)
    return { ahead: has("w") - has("s"), left: has("a") - has("d") }
  }

  #pressed(event) {
    const name = (event.key ?? "").toLowerCase(), { code } = event  // forms that a browser fills in send no key
    if ((name === " " || code === "Space") && !typing(event.target)) {
      event.preventDefault()
      if (!event.repeat) this.called.stop()
      return
    }
    const modified = event.ctrlKey || event.altKey || event.metaKey || event.getModifierState("AltGraph")
    const composed = event.isComposing || event.keyCode === 229  // an input method has taken the key
    if (MODIFIERS.includes(event.key) || modified || composed) return this.#end()
    if (this.#down.has(code) && this.#known.get(code).name !== name) this.#end()  // another layout
    if (typing(event.target)) return
    const move = MOVES[name]
    if (move) event.preventDefault()
    if (event.repeat) return
    if (move) {
      if (this.hold.by !== "keys") this.#down.clear()
      this.#down.add(code)
      this.#known.set(code, { name, move })
      this.hold.press("keys", event.timeStamp)
      this.called.moved()
    } else if (name === "m") {
      this.#arm = code
      this.called.arm(true)
    } else if (name === "+" || name === "-") this.called.speed(name === "+" ? 0.1 : -0.1)
  }

  #released({ code }) {
    if (code === this.#arm) this.#disarm()
    if (!this.#known.has(code)) return
    this.#down.delete(code)
    if (!this.#down.size) this.hold.end()
    this.called.moved()
  }

  #disarm() {
    if (this.#arm) this.called.arm(false)
    this.#arm = ""
  }

  #end() {
    this.#disarm()
    if (this.hold.by !== "keys") return
    this.hold.end()
    this.called.moved()
  }
}
