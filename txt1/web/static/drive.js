// Driving by stick, keys and gamepad: each is a dead-man, and whatever takes the page out of sight lets go of all of them.

import { Gamepad } from "./gamepad.js"
import { axes, shaped, velocity } from "./hand.js"

const PERIOD = 40  // ms between two commands
const STALL = 200  // ms without a turn after which nobody knows what the hand wanted meanwhile
const DEAF = 400  // ms without telemetry after which the robot may long have stopped: it does not go on by itself
const HOLD = 500  // ms that arming takes
const KEYS = { w: "w", a: "a", s: "s", d: "d", ArrowUp: "w", ArrowLeft: "a", ArrowDown: "s", ArrowRight: "d" }

export class Drive {
  #pointer = null  // {id, ahead, left} while the stick is held
  #keys = new Set()
  #pad = new Gamepad({ stop: () => this.stop(), arm: () => this.link.command({ do: "arm" }) })
  #active = false
  #last = performance.now()
  #route = false
  speed = 0.5
  hand = null  // the car's numbers for the hand rule; until the robot has told them, nothing drives

  // `elements`: stick, knob, arm; `changed` is told by what the page drives
  constructor(link, elements, changed) {
    this.link = link
    this.elements = elements
    this.changed = changed
    this.#listenToStick()
    this.#listenToArm()
    this.#listenToKeys()
    this.#listenToPage()
    setInterval(() => this.#tick(), PERIOD)
  }

  stop() {
    this.link.stop()
    this.letGo()
  }

  // Neutral at once; each dead-man has to be let go and taken anew.
  letGo() {
    this.#pointer = null
    this.#keys.clear()
    this.#pad.ready = false
    this.#holdArm(false)
    if (this.#active || this.#route) this.link.send({ do: "release" })
    this.#active = this.#route = false
    this.#show()
  }

  // Drive along points, for as long as this page is looked at and nobody lets go.
  go(points, speed) {
    this.link.command({ do: "go", points, speed })
    this.#route = true
  }

  arrived() { this.#route = false }

  get driving() { return this.#active || this.#route }

  // What a hand holds: both axes, and whether left is that of a steering wheel; null where it holds nothing.
  #held() {
    if (this.#pointer) return { ahead: shaped(this.#pointer.ahead), left: shaped(this.#pointer.left) }
    if (!this.#keys.size) return this.#pad.look()
    const has = (key) => (this.#keys.has(key) ? 1 : 0)
    return { ahead: has("w") - has("s"), left: (has("a") - has("d")) * this.hand?.turn, wheel: true }
  }

  #tick() {
    const now = performance.now()
    if (this.driving && (now - this.#last > STALL || now - this.link.heard > DEAF)) this.letGo()
    this.#last = now
    const held = this.#held()
    const command = held && this.hand && velocity(this.hand, this.speed, held.ahead, held.left, held.wheel)
    if (command) {
      this.#route = false
      this.#active = true
      this.link.command({ do: "drive", ...command }, now)
    } else if (this.#active) {
      this.#active = false
      this.link.send({ do: "release" })
    } else if (this.#route) {
      this.link.command({ do: "hold" }, now)
    }
    this.#show(command)
  }

  #show(command = null) {
    const { stick, knob } = this.elements
    const reach = stick.clientWidth / 2 - knob.clientWidth / 2
    const { ahead, left } = this.#pointer ?? (command ? axes(this.hand, this.speed, command) : { ahead: 0, left: 0 })
    knob.style.transform = `translate(${-left * reach}px, ${-ahead * reach}px)`
    stick.classList.toggle("held", command !== null)
    this.changed(this.#pointer ? "stick" : this.#keys.size ? "keys" : command ? "gamepad" : this.#route ? "route" : "")
  }

  #holdArm(down) {
    clearTimeout(this.arming)
    this.elements.arm.classList.toggle("held", down)
    if (down) this.arming = setTimeout(() => {
      this.elements.arm.classList.remove("held")
      this.link.command({ do: "arm" })
    }, HOLD)
  }

  #listenToStick() {
    const { stick, knob } = this.elements
    const place = (event) => {
      const box = stick.getBoundingClientRect()
      const reach = box.width / 2 - knob.clientWidth / 2
      let x = (event.clientX - box.left - box.width / 2) / reach
      let y = (event.clientY - box.top - box.height / 2) / reach
      const far = Math.max(1, Math.hypot(x, y))
      this.#pointer = { id: event.pointerId, ahead: -y / far, left: -x / far }
      this.#tick()
    }
    stick.addEventListener("pointerdown", (event) => {
      if (this.#pointer || event.button) return
      event.preventDefault()
      stick.focus({ preventScroll: true })
      stick.setPointerCapture(event.pointerId)
      place(event)
    })
    stick.addEventListener("pointermove", (event) => {
      if (event.pointerId === this.#pointer?.id) place(event)
    })
    for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) {
      stick.addEventListener(kind, (event) => {
        if (event.pointerId !== this.#pointer?.id) return
        this.#pointer = null
        this.#tick()
      })
    }
    stick.addEventListener("contextmenu", (event) => event.preventDefault())
  }

  #listenToArm() {
    const { arm } = this.elements
    arm.addEventListener("pointerdown", (event) => {
      if (event.button) return
      if (arm.dataset.armed) this.link.send({ do: "disarm" })
      else this.#holdArm(true)
    })
    for (const kind of ["pointerup", "pointercancel", "pointerleave"]) {
      arm.addEventListener(kind, () => this.#holdArm(false))
    }
    arm.addEventListener("contextmenu", (event) => event.preventDefault())
  }

  #listenToKeys() {
    addEventListener("keydown", (event) => {
      if (event.key === " " && !typing(event.target)) {
        event.preventDefault()
        if (!event.repeat) this.stop()
        return
      }
      if (typing(event.target) || event.ctrlKey || event.altKey || event.metaKey) return
      const key = KEYS[event.key] ?? KEYS[event.key.toLowerCase()]
      if (key) event.preventDefault()
      if (event.repeat) return
      if (key) {
        this.#keys.add(key)
        this.#tick()
      } else if (event.key === "m" && !this.elements.arm.dataset.armed) this.#holdArm(true)
      else if (event.key === "+" || event.key === "-") this.elements.speed(event.key === "+" ? 0.1 : -0.1)
    })
    addEventListener("keyup", (event) => {
      const key = KEYS[event.key] ?? KEYS[event.key.toLowerCase()]
      if (key && this.#keys.delete(key)) this.#tick()
      if (event.key === "m") this.#holdArm(false)
    })
  }

  #listenToPage() {
    for (const kind of ["blur", "pagehide"]) addEventListener(kind, () => this.letGo())
    for (const kind of ["visibilitychange", "freeze"]) {
      document.addEventListener(kind, () => {
        if (kind === "freeze" || document.hidden) this.letGo()
      })
    }
  }
}

function typing(target) {
  return target instanceof HTMLInputElement && target.type !== "range" || target instanceof HTMLSelectElement
}
