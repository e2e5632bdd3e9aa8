// Driving by stick, keys and gamepad: the hand that holds becomes a velocity, and letting go becomes a release.

import { Gamepads } from "./gamepad.js"
import { axes, shaped, velocity } from "./hand.js"
import { Hold, LASTS, outOfSight } from "./hold.js"
import { Keys } from "./keys.js"
import { Stick } from "./stick.js"

const PERIOD = 40  // ms between two commands
const STALL = 200  // ms without a turn after which nobody knows what the hand wanted meanwhile
const DEAF = 400  // ms without telemetry after which the robot may long have stopped: it does not go on by itself
const ARMS = 500  // ms that arming takes
const EXPIRED = `no sign of a hand for ${LASTS / 1000} s: let go and press again`

export class Drive {
  #active = false
  #last = performance.now()
  #route = false
  speed = 0.5
  hand = null  // the car's numbers for the hand rule; until the robot has told them, nothing drives

  // `elements`: stick, knob, arm; `changed` is told by what the page drives, and `tell` what a person should know
  constructor(link, elements, changed, tell = () => {}) {
    this.link = link
    this.elements = elements
    this.changed = changed
    const stop = () => this.stop(), tick = () => this.#tick()
    const arm = (down) => this.#holdArm(down && !elements.arm.dataset.armed)
    this.hold = new Hold(() => tell(EXPIRED))
    this.stick = new Stick(this.hold, elements, tick)
    this.keys = new Keys(this.hold, { moved: tick, stop, arm, speed: elements.speed })
    this.pads = new Gamepads(this.hold, {
      stop, arm,
      strange: (name) => tell(`'${name}' cannot drive, as the browser does not know its buttons; each of them stops`),
    })
    this.#listenToArm()
    outOfSight(() => this.letGo())
    setInterval(tick, PERIOD)
  }

  stop() {
    this.link.stop()
    this.letGo()
  }

  // Neutral at once; each dead-man has to be let go and taken anew.
  letGo() {
    this.hold.end()
    this.#holdArm(false)
    if (this.driving) this.link.send({ do: "release" })
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

  // The command of the hand that drives; null where none does.
  #command(now) {
    const by = this.hold.drives(now), { hand, speed } = this
    if (!by || !hand) return null
    const { ahead, left } = by === "keys" ? this.keys.axes : by === "stick" ? this.stick.axes : this.pads.axes
    if (by === "keys") return velocity(hand, speed, ahead, left * hand.turn, true)
    return velocity(hand, speed, shaped(ahead), shaped(left))
  }

  #tick() {
    const now = performance.now()
    if ((this.driving || this.hold.by) && (now - this.#last > STALL || now - this.link.heard > DEAF)) this.letGo()
    this.#last = now
    this.pads.look(now)
    const command = this.#command(now)
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
    const { stick, knob } = this.elements, { by } = this.hold
    const reach = stick.clientWidth / 2 - knob.clientWidth / 2
    const { ahead, left } = by === "stick" ? this.stick.axes
      : command ? axes(this.hand, this.speed, command) : { ahead: 0, left: 0 }
    knob.style.transform = `translate(${-left * reach}px, ${-ahead * reach}px)`
    stick.classList.toggle("held", command !== null)
    this.changed(by || (this.#route ? "route" : ""))
  }

  #holdArm(down) {
    clearTimeout(this.arming)
    this.elements.arm.classList.toggle("held", down)
    if (down) this.arming = setTimeout(() => {
      this.elements.arm.classList.remove("held")
      this.link.command({ do: "arm" })
    }, ARMS)
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
}
