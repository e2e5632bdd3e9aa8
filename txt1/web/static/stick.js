// The stick under a mouse, a pen or a finger. The browser tells when the pointer goes up; a pointer that is told to be
// up, or to be captured no more, lets go. A pointer at rest tells nothing, so only its changes are signs of a hand.

export class Stick {
  #pointer = null  // {id, told, ahead, left} from its press to its release

  // `hold`; `moved` is called when the pointer is another or elsewhere
  constructor(hold, { stick, knob }, moved) {
    this.hold = hold
    const place = (event) => {
      const box = stick.getBoundingClientRect()
      const reach = box.width / 2 - knob.clientWidth / 2
      const x = (event.clientX - box.left - box.width / 2) / reach
      const y = (event.clientY - box.top - box.height / 2) / reach
      const far = Math.max(1, Math.hypot(x, y))
      const told = [event.clientX, event.clientY, event.pressure, event.width, event.height].join()
      if (told !== this.#pointer?.told) this.hold.sign("stick", event.timeStamp)
      this.#pointer = { id: event.pointerId, told, ahead: -y / far, left: -x / far }
      moved()
    }
    const release = (event) => {
      if (event.pointerId !== this.#pointer?.id) return
      this.#pointer = null
      this.hold.end()
      moved()
    }
    stick.addEventListener("pointerdown", (event) => {
      if (event.button || this.#pointer && this.hold.by === "stick") return
      event.preventDefault()
      stick.focus({ preventScroll: true })
      stick.setPointerCapture(event.pointerId)
      this.hold.press("stick", event.timeStamp)
      place(event)
    })
    stick.addEventListener("pointermove", (event) => {
      if (event.pointerId !== this.#pointer?.id) return
      if (event.buttons & 1) place(event)
      else release(event)
    })
    for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) stick.addEventListener(kind, release)
    stick.addEventListener("contextmenu", (event) => event.preventDefault())
  }

  get axes() { return this.#pointer ?? { ahead: 0, left: 0 } }
}
