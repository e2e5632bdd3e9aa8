// The map: room or walls, obstacles, light, laser points, path, waypoints, and the robots; x to the right, y up, metres.

const AHEAD = 0.15  // s that the pose is drawn ahead of the last telemetry, at most
const STEP = 0.02  // m between two points of the path
const JUMP = 0.5  // m from one telemetry to the next that tell that the robot was lifted ...
const REACH = 2.0  // ... unless it could drive there at so many m/s
const PATH_MAX = 8000
const VIEW_MIN = 2.0  // m, the smallest view without a room

export class Map2d {
  path = []
  waypoints = []
  scan = []  // laser points, m
  #poses = []  // [time, pose] of the last two seconds
  frames = 0
  follow = false
  #robot = null  // {pose, v, omega, at}
  #zoom = 1
  #before = 0  // s of the run at which the path ended before a reload
  #view = { scale: 100, x: 0, y: 0, width: 1, height: 1 }
  #colours = null

  constructor(canvas) {
    this.canvas = canvas
    this.context = canvas.getContext("2d")
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault()
      this.#zoom = Math.min(20, Math.max(0.3, this.#zoom * Math.exp(-event.deltaY / 400)))
    }, { passive: false })
    const draw = () => {
      this.#draw()
      this.frames++
      requestAnimationFrame(draw)
    }
    requestAnimationFrame(draw)
  }

  repaint() { this.#colours = null }

  // What outlives a reload of the page; `restore` takes it again.
  kept() {
    return { path: this.path.slice(-2000), zoom: this.#zoom, follow: this.follow, time: this.#poses.at(-1)?.[0] ?? 0 }
  }

  restore({ path, zoom, follow, time }) {
    this.path = path
    this.#zoom = zoom
    this.follow = follow
    this.#before = time
  }

  clear() {
    this.path = []
    this.scan = []
    this.#robot = null
  }

  take(time, topics, about) {
    // of a robot with a map of its own, nothing of the simulated room is drawn
    const there = topics["/map_pose"]
    this.about = there ? { "/surroundings": { body: about["/surroundings"]?.body }, "/walls": about["/map_walls"] } : about
    this.others = there ? [] : topics["/vehicles"] ?? []
    this.movers = there ? [] : topics["/movers"] ?? []
    this.particles = there ? topics["/particles"] ?? [] : []
    this.sigma = there?.sigma
    this.lost = Boolean(there?.lost)
    this.frontiers = there ? about["/frontiers"] ?? {} : {}
    this.route = about["/route"] ?? []
    const odometry = topics["/odom"], estimate = topics["/odometry/filtered"], best = there ?? estimate ?? odometry
    const pose = (!there && topics["/pose"]) || (best && [best.x, best.y, best.theta])
    this.estimate = estimate && (estimate.located || !(there ?? topics["/pose"])) ? estimate : null
    const frame = there ? "map" : topics["/pose"] ? "room" : estimate ? "estimate" : "odometry"
    if (frame !== this.frame) this.path = this.#before ? this.path : []
    this.frame = frame
    if (there?.lost || !pose || !pose.every(Number.isFinite)) {
      this.#robot = null
      return
    }
    this.#robot = { pose, v: odometry?.v ?? 0, omega: odometry?.omega ?? 0, at: performance.now() }
    if (time < this.#before) this.path = []  // the run is another one
    this.#before = 0
    const elapsed = time - (this.#poses.at(-1)?.[0] ?? time)
    if (elapsed <= 0) this.#poses = []
    this.#poses.push([time, pose])
    while (this.#poses[0][0] < time - 2) this.#poses.shift()
    const last = this.path.at(-1)
    const gone = last ? Math.hypot(pose[0] - last[0], pose[1] - last[1]) : Infinity
    if (last && gone > Math.max(JUMP, REACH * elapsed)) this.path.push(null)
    if (gone > STEP) this.path.push([pose[0], pose[1]])
    if (this.path.length > PATH_MAX) this.path.splice(0, 1000)
  }

  // A sweep of a laser that began at `time`: each beam from where the robot was then.
  sweep(time, { ranges, angle_min: first, angle_step: step, time_step: pause, mount }) {
    this.scan = ranges.flatMap((range, index) => {
      const from = Number.isFinite(range) ? this.#poseAt(time + index * pause) : null
      if (!from) return []
      const [x, y, theta] = from, cos = Math.cos(theta), sin = Math.sin(theta), angle = theta + mount.yaw + first + index * step
      return [[
        x + mount.x * cos - mount.y * sin + range * Math.cos(angle), y + mount.x * sin + mount.y * cos + range * Math.sin(angle),
      ]]
    })
  }

  #poseAt(time) {
    const poses = this.#poses, index = poses.findIndex((each) => each[0] >= time)
    if (index <= 0) return (index < 0 ? poses.at(-1) : poses[0])?.[1] ?? null
    const [t0, a] = poses[index - 1], [t1, b] = poses[index], share = (time - t0) / (t1 - t0)
    const turn = Math.atan2(Math.sin(b[2] - a[2]), Math.cos(b[2] - a[2]))
    return [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * turn]
  }

  get pose() {
    if (!this.#robot) return null
    const { pose: [x, y, theta], v, omega, at } = this.#robot
    const dt = Math.min(AHEAD, (performance.now() - at) / 1000)
    return [x + v * dt * Math.cos(theta + omega * dt / 2), y + v * dt * Math.sin(theta + omega * dt / 2), theta + omega * dt]
  }

  // The place of a pixel of the canvas, m.
  place(px, py) {
    const { scale, x, y, width, height } = this.#view
    return [x + (px - width / 2) / scale, y - (py - height / 2) / scale]
  }

  // The pixel of a place.
  pixel([wx, wy]) {
    const { scale, x, y, width, height } = this.#view
    return [(wx - x) * scale + width / 2, height / 2 - (wy - y) * scale]
  }

  #frame(width, height) {
    const { room, light } = this.about?.["/surroundings"] ?? {}, walls = this.about?.["/walls"] ?? []
    let left = -VIEW_MIN / 2, right = VIEW_MIN / 2, low = -VIEW_MIN / 2, high = VIEW_MIN / 2
    if (walls.length) {
      const xs = walls.flat().map(([x]) => x), ys = walls.flat().map(([, y]) => y)
      ;[left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)]
    } else if (room) [left, right, low, high] = [-room[0] / 2, room[0] / 2, -room[1] / 2, room[1] / 2]
    else for (const point of [...this.path, ...this.waypoints, ...(this.others ?? []), this.pose, light]) {
      if (!point) continue
      left = Math.min(left, point[0] - 0.5)
      right = Math.max(right, point[0] + 0.5)
      low = Math.min(low, point[1] - 0.5)
      high = Math.max(high, point[1] + 0.5)
    }
    const pose = this.follow ? this.pose : null
    const fits = Math.min((width - 24) / (right - left), (height - 64) / (high - low))  // a line of text is below
    const scale = (pose ? Math.max(fits, Math.min(width, height) / 4) : fits) * this.#zoom
    this.#view = { scale, x: pose ? pose[0] : (left + right) / 2, y: pose ? pose[1] : (low + high) / 2, width, height }
  }

  #draw() {
    const { canvas, context: c } = this
    const density = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight
    if (!width || !height) return
    if (canvas.width !== Math.round(width * density) || canvas.height !== Math.round(height * density)) {
      canvas.width = Math.round(width * density)
      canvas.height = Math.round(height * density)
    }
    this.#colours ??= colours(canvas)
    const colour = this.#colours
    this.#frame(width, height)
    const { scale, x, y } = this.#view
    c.setTransform(density, 0, 0, density, 0, 0)
    c.clearRect(0, 0, width, height)
    // from here on in metres
    c.setTransform(density * scale, 0, 0, -density * scale, density * (width / 2 - x * scale), density * (height / 2 + y * scale))
    const pixel = 1 / scale
    c.lineJoin = c.lineCap = "round"
    this.#grid(c, colour, pixel)
    const { room, light, body = [0.51, 0.385], obstacles = [] } = this.about?.["/surroundings"] ?? {}
    c.strokeStyle = colour.wall
    c.lineWidth = 2.5 * pixel
    if (room) c.strokeRect(-room[0] / 2, -room[1] / 2, room[0], room[1])
    for (const corners of this.about?.["/walls"] ?? []) {
      trace(c, corners)
      c.closePath()
      c.stroke()
    }
    c.fillStyle = colour.line
    for (const corners of obstacles) {
      trace(c, corners)
      c.closePath()
      c.fill()
      c.stroke()
    }
    if (light) this.#light(c, colour, light, pixel)
    c.strokeStyle = colour.path
    c.lineWidth = 2 * pixel
    c.beginPath()
    let pen = false
    for (const point of this.path) {
      if (!point) pen = false
      else if (pen) c.lineTo(point[0], point[1])
      else c.moveTo(point[0], point[1]), pen = true
    }
    const pose = this.pose
    if (pose && pen) c.lineTo(pose[0], pose[1])
    c.stroke()
    this.#points(c, colour, pixel)
    c.strokeStyle = colour.other
    for (const corners of this.movers ?? []) {
      trace(c, corners)
      c.closePath()
      c.stroke()
    }
    for (const other of this.others ?? []) this.#body(c, other, body, colour.other, pixel)
    const dot = 2.5 * pixel
    c.fillStyle = colour.other
    for (const [x, y] of this.particles ?? []) c.fillRect(x - dot / 2, y - dot / 2, dot, dot)
    if (!pose) return
    c.fillStyle = colour.scan
    for (const [x, y] of this.scan) c.fillRect(x - dot / 2, y - dot / 2, dot, dot)
    this.#body(c, pose, body, colour.robot, pixel)
    this.#uncertainty(c, colour, pixel)
  }

  #grid(c, colour, pixel) {
    const { x, y, width, height } = this.#view
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10].find((each) => each >= 40 * pixel) ?? 20
    const left = x - width / 2 * pixel, right = x + width / 2 * pixel, low = y - height / 2 * pixel, high = y + height / 2 * pixel
    c.strokeStyle = colour.grid
    c.lineWidth = pixel
    c.beginPath()
    for (let at = Math.ceil(left / step) * step; at <= right; at += step) c.moveTo(at, low), c.lineTo(at, high)
    for (let at = Math.ceil(low / step) * step; at <= high; at += step) c.moveTo(left, at), c.lineTo(right, at)
    c.stroke()
    this.step = step
  }

  #light(c, colour, [x, y], pixel) {
    const size = Math.max(0.07, 9 * pixel)
    c.strokeStyle = c.fillStyle = colour.light
    c.lineWidth = 2 * pixel
    c.beginPath()
    c.arc(x, y, size / 2, 0, 2 * Math.PI)
    c.fill()
    for (let k = 0; k < 8; k++) {
      const [cos, sin] = [Math.cos(k * Math.PI / 4), Math.sin(k * Math.PI / 4)]
      c.beginPath()
      c.moveTo(x + 0.75 * size * cos, y + 0.75 * size * sin)
      c.lineTo(x + 1.2 * size * cos, y + 1.2 * size * sin)
      c.stroke()
    }
  }

  #points(c, colour, pixel) {
    const { cells = [], goal } = this.frontiers ?? {}, dot = 3 * pixel
    c.strokeStyle = c.fillStyle = colour.goal
    for (const [x, y] of cells) c.fillRect(x - dot / 2, y - dot / 2, dot, dot)
    const going = this.route?.length ? this.route : goal ? [goal] : []
    const points = this.waypoints.length ? this.waypoints : going
    if (!points.length) return
    c.lineWidth = 2 * pixel
    c.setLineDash([8 * pixel, 6 * pixel])
    trace(c, this.pose ? [this.pose, ...points] : points)
    c.stroke()
    c.setLineDash([])
    for (const [x, y] of points) {
      c.beginPath()
      c.arc(x, y, 6 * pixel, 0, 2 * Math.PI)
      c.fill()
    }
  }

  // The estimated pose: an ellipse of two standard deviations, and the heading within two of its own.
  #uncertainty(c, colour, pixel) {
    if (!this.estimate) return
    const { x, y, theta, covariance } = this.estimate
    const xx = covariance[0], xy = covariance[1], yy = covariance[6], spread = 2 * Math.sqrt(Math.max(0, covariance[12]))
    const mean = (xx + yy) / 2, apart = Math.hypot((xx - yy) / 2, xy)
    const long = 2 * Math.sqrt(Math.max(0, mean + apart)), short = 2 * Math.sqrt(Math.max(0, mean - apart))
    c.strokeStyle = c.fillStyle = colour.path
    c.lineWidth = 1.5 * pixel
    c.beginPath()
    c.ellipse(x, y, long, short, Math.atan2(2 * xy, xx - yy) / 2, 0, 2 * Math.PI)
    c.stroke()
    c.globalAlpha = 0.3
    c.beginPath()
    c.moveTo(x, y)
    c.arc(x, y, Math.max(0.5, 40 * pixel), theta - Math.min(Math.PI, spread), theta + Math.min(Math.PI, spread))
    c.fill()
    c.globalAlpha = 1
  }

  #body(c, [x, y, theta], [length, width], fill, pixel) {
    c.save()
    c.translate(x, y)
    c.rotate(theta)
    const larger = Math.max(1, 26 * pixel / length), l = length * larger / 2, w = width * larger / 2
    c.fillStyle = this.#colours.wall
    for (const [ax, ay] of [[0.55, 0.78], [0.55, -0.78], [-0.55, 0.78], [-0.55, -0.78]]) {
      c.fillRect(ax * l - 0.3 * l, ay * w - 0.22 * w, 0.6 * l, 0.44 * w)
    }
    c.fillStyle = fill
    c.beginPath()
    c.roundRect(-0.92 * l, -0.66 * w, 1.84 * l, 1.32 * w, 0.25 * w)
    c.fill()
    c.fillStyle = this.#colours.card
    c.beginPath()
    c.moveTo(0.82 * l, 0)
    c.lineTo(-0.1 * l, 0.36 * w)
    c.lineTo(-0.1 * l, -0.36 * w)
    c.fill()
    c.restore()
  }
}

function trace(c, points) {
  c.beginPath()
  points.forEach(([x, y], index) => (index ? c.lineTo(x, y) : c.moveTo(x, y)))
}

export function colours(element) {
  const style = getComputedStyle(element)
  const names = ["grid", "wall", "line", "path", "robot", "other", "light", "goal", "scan", "card", "text", "dim"]
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]))
}
