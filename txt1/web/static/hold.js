// What a hold is, and how it ends: one rule for keys, pointers and gamepads.
//
// A hold begins with a fresh press: a key, a pointer or a dead-man button was up and goes down. It lasts as long as
// signs of a hand come: another fresh press, a pointer that moves, a part of a pad that moves. What a computer makes by
// itself is no sign: a key's repeats, a button that is still down, a pad's time stamp. So a hold ends
//   - when any dead-man is released, also one that does not drive;
//   - when the computer may keep a release to itself (`swallowed`), or the page is out of sight;
//   - LASTS ms after the last sign.
// A hold that has ended comes back by a fresh press alone. A fresh press of another hand takes over: the first hold
// ends, the robot is commanded zero, and HANDOVER ms later the new hand drives.

export const LASTS = 3000  // ms without a sign of a hand
const HANDOVER = 100  // ms of zero between two hands

export class Hold {
  by = ""  // the hand that holds; "" for none
  #sign = 0  // time of the last sign, ms of this page
  #last = { by: "", ended: -Infinity }  // the hold before

  constructor(expired) { this.expired = expired }  // called when a hold ends without a sign of a hand

  // A fresh press at `time`.
  press(by, time) {
    if (this.by !== by) this.end()
    this.by = by
    this.#sign = time
  }

  // A sign of a hand: it renews this hand's hold, and begins none.
  sign(by, time) {
    if (this.by === by) this.#sign = Math.max(this.#sign, time)
  }

  end() {
    if (this.by) this.#last = { by: this.by, ended: performance.now() }
    this.by = ""
  }

  // The hand that drives now; "" for none.
  drives(now) {
    if (this.by && now - this.#sign > LASTS) {
      this.end()
      this.expired()
    }
    return this.by !== this.#last.by && now - this.#last.ended < HANDOVER ? "" : this.by
  }
}

// Calls `end` where a key that goes up may never be told: a menu, a drag, an input method or a text field takes it.
export function swallowed(end) {
  for (const kind of ["contextmenu", "dragstart", "compositionstart"]) {
    addEventListener(kind, (event) => event.defaultPrevented || end())
  }
  addEventListener("focusin", (event) => typing(event.target) && end())
}

// Calls `end` when the page is out of sight, or about to be.
export function outOfSight(end) {
  for (const kind of ["blur", "pagehide"]) addEventListener(kind, end)
  for (const kind of ["visibilitychange", "freeze"]) {
    document.addEventListener(kind, () => (kind === "freeze" || document.hidden) && end())
  }
}

export function typing(target) {
  return target instanceof HTMLInputElement && target.type !== "range" || target instanceof HTMLSelectElement
}
