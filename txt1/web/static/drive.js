// Driving by stick, keys and gamepad: each is a dead-man, and whatever takes the page out of sight lets go of all of them.

const PERIOD = 40  // ms between two commands
const STALL = 200  // ms without a turn after which nobody knows what the hand wanted meanwhile
const DEAF = 400  // ms without telemetry after which the robot may long have stopped: it does not go on by itself
const RADIUS = 0.56  // m, the smallest circle
const TURN = 0.8  // share of the largest yaw rate that a and d ask for
const DEAD = 0.08  // share of a stick's way around its middle that counts as none
const HOLD = 500  // ms that arming takes
const DEAD_MAN = 0, STOP = 1, ARM = 9, TRIGGER = 7  // buttons of a standard gamepad: A, B, start, right trigger
const KEYS = { w: "w", a: "a", s: "s", d: "d", ArrowUp: "w", ArrowLeft: "a", ArrowDown: "s", ArrowRight: "d" }

export function shaped(value) {
  const size = Math.min(1, Math.max(0, (Math.abs(value) - DEAD) / (1 - DEAD)))
  return Math.sign(value) * size
}

// The original's rule: v by one axis, omega = |v| / R times the other; ahead and left are positive.
export function velocity(ahead, left, speed) {
  const v = shaped(ahead) * speed
  return { v, omega: Math.abs(v) / RADIUS * shaped(left) || 0 }
}

export class Drive {
  #pointer = null  // {id, ahead, left} while the stick is held
  #keys = new Set()
  #pad = { ready: false, stopped: false, arming: 0 }
  #active = false
  #last = performance.now()
  #route = false
  speed = 0.5

  // `elements`: stick, knob, arm; `changed` is told by what the page drives
  constructor(link, elements, changed) {
    this.link = link
    this.elements = elements
    this.changed = changed
    this.#listen()
    setInterval(() => this.#tick(), PERIOD)
  }

  stop() {
    this.link.send({ do: "stop" })
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

  #command() {
    if (this.#pointer) return velocity(this.#pointer.ahead, this.#pointer.left, this.speed)
    if (this.#keys.size) {
      const has = (key) => (this.#keys.has(key) ? 1 : 0)
      const v = (has("w") - has("s")) * this.speed
      return { v, omega: (has("a") - has("d")) * TURN * v / RADIUS || 0 }
    }
    return this.#gamepad()
  }

  #gamepad() {
    const pad = [...(navigator.getGamepads?.() ?? [])].find((each) => each?.connected && each.mapping === "standard")
    if (!pad || document.hidden || !document.hasFocus()) {
      this.#pad.ready = false
      return null
    }
    const pressed = (button) => pad.buttons[button]?.pressed ?? false
    if (pressed(STOP) && !this.#pad.stopped) this.stop()
    this.#pad.stopped = pressed(STOP)
    if (pressed(ARM)) this.#pad.arming ||= performance.now()
    else this.#pad.arming = 0
    if (this.#pad.arming > 0 && performance.now() - this.#pad.arming >= HOLD) {
      this.#pad.arming = -1  // once
      this.link.command({ do: "arm" })
    }
    if (!pressed(DEAD_MAN)) {
      this.#pad.ready = true
      return null
    }
    if (!this.#pad.ready) return null
    const pull = pad.buttons[TRIGGER]?.value ?? 0
    return velocity(pull > DEAD ? pull : -pad.axes[1], -pad.axes[0], this.speed)
  }

  #tick() {
    const now = performance.now()
    if (this.driving && (now - this.#last > STALL || now - this.link.heard > DEAF)) this.letGo()
    this.#last = now
    const command = this.#command()
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
    let ahead = 0, left = 0
    if (this.#pointer) ({ ahead, left } = this.#pointer)
    else if (command && this.speed) {
      ahead = command.v / this.speed
      left = command.v ? command.omega * RADIUS / Math.abs(command.v) : 0
    }
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

  #listen() {
    const { stick, knob, arm } = this.elements
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

    arm.addEventListener("pointerdown", (event) => {
      if (event.button) return
      if (arm.dataset.armed) this.link.send({ do: "disarm" })
      else this.#holdArm(true)
    })
    for (const kind of ["pointerup", "pointercancel", "pointerleave"]) {
      arm.addEventListener(kind, () => this.#holdArm(false))
    }
    arm.addEventListener("contextmenu", (event) => event.preventDefault())

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
      } else if (event.key === "m" && !arm.dataset.armed) this.#holdArm(true)
      else if (event.key === "+" || event.key === "-") this.elements.speed(event.key === "+" ? 0.1 : -0.1)
    })
    addEventListener("keyup", (event) => {
      const key = KEYS[event.key] ?? KEYS[event.key.toLowerCase()]
      if (key && this.#keys.delete(key)) this.#tick()
      if (event.key === "m") this.#holdArm(false)
    })

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
