// The page: what comes from the robot goes to map, curves and panels; what is pressed goes to the robot.

import { Camera } from "./camera.js"
import { Chart, format } from "./chart.js"
import { Drive } from "./drive.js"
import { Link } from "./link.js"
import { Map2d } from "./map.js"
import { element, leaves, panels } from "./panels.js"

const SILENT = 700  // ms without telemetry after which it is said
const LATE = 300  // ms after which a stop that the robot has not confirmed is said
const TOAST = 5000  // ms
const NO_PLOT = ["/capabilities", "/hand", "/surroundings", "/walls", "/map_walls", "/movers", "/events", "/gain_table"]

const $ = (id) => document.getElementById(id)

const know = {
  topics: {},  // the newest value of each
  time: 0,  // s of the run
  name: "",
  page: {},  // what the server says of this page
  files: null,
  fps: 0,
  learning: { steps: [], episodes: new Map(), decisions: 0 },
  plot: { topic: "", field: "", fields: [], points: [], chart: null },
  send: (request) => link.send(request),
  choices: () => [...new Set([
    ...Object.keys(know.topics).filter((name) => !NO_PLOT.includes(name)),
    ...(know.topics["/sensors"] ?? []).map((sensor) => `/sensors/${sensor.name}`), "/learning/step", "/teaching",
  ])].sort(),
  choose(topic, field) {
    if (topic !== know.plot.topic) know.plot.fields = []
    Object.assign(know.plot, { topic, field, points: [] })
    know.plot.chart?.clear()
    subscribe()
  },
  replay: (name) => {
    forget()
    link.send(name ? { do: "replay", name } : { do: "replay" })
  },
  signOut: async () => {
    await fetch("sign-out", { method: "POST" })
    location.reload()
  },
}

let tab = "events"
const map = new Map2d($("map"))
const speeds = new Chart($("v-chart"), ["robot", "goal"], 0.2)
const turns = new Chart($("w-chart"), ["robot", "goal"], 0.2)
const charts = [speeds, turns]
const camera = new Camera({ card: $("camera"), canvas: $("camera-picture"), age: $("camera-age"), trust: $("camera-trust") })
const link = new Link({ telemetry, message, change })
const drive = new Drive(link, { stick: $("stick"), knob: $("knob"), arm: $("arm"), speed: changeSpeed }, driving, toast)

// -- from the robot

function telemetry(snapshot) {
  if (snapshot.name !== know.name || snapshot.time < know.time - 1) forget()
  know.time = snapshot.time
  know.name = snapshot.name
  if ("/capabilities" in snapshot.topics) {
    know.topics = { ...snapshot.topics }  // all there is: what is absent is gone
    drive.hand = know.topics["/hand"] ?? null
    limitSpeed()
  }
  else Object.assign(know.topics, snapshot.topics)
  for (const { time, text } of snapshot.topics["/events"] ?? []) {
    if (/^episode \d+: /.test(text)) know.learning.episodes.set(`${time} ${text}`, text)
  }
  map.take(know.time, know.topics, know.topics)
  for (const event of snapshot.events ?? []) occurred(event)
  const odometry = know.topics["/odom"], goal = know.topics["/setpoint"]
  if (odometry) {
    speeds.add(know.time, odometry.v, goal?.v)
    turns.add(know.time, odometry.omega, goal?.omega)
  }
  const { topic } = know.plot
  if (topic in snapshot.topics) plotted(know.time, snapshot.topics[topic])
}

// What was told of another robot, or of another run.
function forget() {
  map.clear()
  charts.forEach((chart) => chart.clear())
  know.topics = {}
  drive.hand = null
  know.learning = { steps: [], episodes: new Map(), decisions: 0 }
  know.look = null
  know.drawn = -1  // which sensors are drawn is found anew
  know.choose(know.plot.topic, know.plot.field)
  camera.forget()
}

function occurred({ topic, time, value }) {
  if (topic === know.plot.topic) plotted(time, value)
  if (topic === "/teaching") know.look = value
  else if (topic === "/learning/step") {
    know.learning.decisions++
    know.learning.steps.push(value)
    if (know.learning.steps.length > 2000) know.learning.steps.shift()
  } else if (Array.isArray(value?.ranges)) map.sweep(time, value)
  else if (typeof value?.data === "string" && value.width && !("focal" in value)) picture(value)
}

// Of a recording, or of a robot of a fleet: the pictures of others come by a socket of their own.
function picture({ data }) {
  if (!streamed()) camera.paint(Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0)))
}

const streamed = () => know.page.camera && !know.page.replay

function lookAtCamera() {
  const names = (know.topics["/sensors"] ?? []).filter(({ values }) => "kB" in values).map(({ name }) => name)
  const select = $("cameras"), text = names.join()
  if (select.dataset.list !== text) {
    select.dataset.list = text
    select.replaceChildren(...names.map((name) => element("option", { value: name }, name)))
    select.hidden = names.length < 2
  }
  const scheme = location.protocol === "https:" ? "wss" : "ws"
  camera.look(streamed() && select.value ? `${scheme}://${location.hostname}:${know.page.camera}/camera/${select.value}` : "")
}

function plotted(time, value) {
  const found = leaves(value), { plot } = know
  plot.fields = found.map(([path]) => path || "value")
  if (!plot.fields.includes(plot.field)) plot.field = plot.fields[0] ?? ""
  const number = found.find(([path]) => (path || "value") === plot.field)?.[1]
  if (number === undefined) return
  plot.points.push([time, number])
  if (plot.points.length > 1000) plot.points.shift()
  plot.chart?.add(time, number)
}

function message({ page, told, files }) {
  if (page) {
    const before = know.page
    know.page = page
    if (page.number !== before.number) subscribe()
    limitSpeed()
    robots()
  }
  if (files) know.files = files
  if (told) toast(told)
}

function change(open) {
  drive.letGo()
  if (open) {
    const robot = sessionStorage.getItem("robot")
    if (robot) link.send({ do: "robot", name: robot })
    link.send({ do: "files" })
  } else know.page = { ...know.page, wheel: 0 }
}

function subscribe() {
  const topics = [know.plot.topic, tab === "tasks" ? "/tasks" : "", "/learning/step", "/teaching", ...sensorTopics()]  // each look at /tasks brings one of them up to date
  link.send({ do: "choose", topics: [...new Set(topics)].filter(Boolean).slice(0, 20) })
}

// Of the sensors those that are drawn: lasers, which count their hits, and cameras, which tell the size of a picture.
function sensorTopics() {
  const drawn = (know.topics["/sensors"] ?? []).filter(({ values }) => "hits" in values || ("kB" in values && !streamed()))
  return drawn.map((sensor) => `/sensors/${sensor.name}`)
}

// -- what is shown

function show() {
  const { topics } = know, mode = topics["/mode"], silent = performance.now() - link.heard > SILENT
  const replay = know.page.replay
  const state = $("state")
  state.className = "pill"
  const ended = silent && link.open && replay  // a recording that was shown to its end sends nothing more
  if (ended) state.textContent = "end"
  else if (silent || !mode) state.textContent = link.open ? "no news" : "connecting"
  else if (replay) state.textContent = "recording"
  else if (mode.stopped) state.textContent = "stopped", state.classList.add("stopped")
  else if (mode.armed) state.textContent = "armed", state.classList.add("armed")
  else state.textContent = "disarmed", state.classList.add("closed")
  const unheard = link.waiting > LATE
  $("lost").hidden = !unheard && (!silent || ended)
  $("lost").textContent = unheard ? "STOP has not reached the robot; stop it in another way" : "no news from the robot"
  const recording = topics["/recording"] ?? ""
  if (recording !== know.recording) {  // begun or ended: the list of files is another
    know.recording = recording
    if (link.open) link.send({ do: "files" })
  }
  const reason = !silent && !replay && mode && !mode.armed ? mode.reason : ""
  $("reason").hidden = !reason
  $("reason").textContent = reason
  const warnings = silent || replay ? [] : [...disobeys(mode), ...topics["/warnings"] ?? []]
  $("warnings").hidden = !warnings.length
  $("warnings").textContent = warnings.join("\n")
  const driver = topics["/driver"]?.name ?? ""
  const holder = know.page.wheel, mine = holder && holder === know.page.number
  $("driver").textContent = driver === "web" ? (mine ? "this page" : `page ${holder}`)
    : driver || (mine ? "this page" : holder ? `page ${holder}` : "nobody")
  $("battery").textContent = battery(topics["/battery1"], topics["/range_left"])
  const alive = mode?.link.alive !== false, sounds = !silent && !replay && buzzer(alive, topics["/battery1"]?.state, know.time)
  $("battery").classList.toggle("sounds", sounds && alive)
  $("link").classList.toggle("sounds", sounds && !alive)
  $("link").textContent = !link.open ? "lost" : silent ? "silent" : mode?.link.alive === false ? "board lost"
    : know.page.round_trip == null ? "alive" : `${Math.round(1000 * know.page.round_trip)} ms`
  $("arm").dataset.armed = mode?.armed && !replay ? "1" : ""
  const visitor = know.page.role === "visitor"
  $("arm").hidden = Boolean(mode?.remote) || (visitor && !mode?.armed)
  $("tabs").querySelector("[data-tab=gains]").hidden = visitor
  $("arm").firstElementChild.textContent = mode?.armed ? "disarm" : "hold to arm"
  $("take").textContent = mine ? "give up the wheel" : holder ? `page ${holder} drives` : "take the wheel"
  $("take").setAttribute("aria-pressed", String(Boolean(mine)))
  $("stick").classList.toggle("off", Boolean(silent || replay || !mode?.armed || (holder && !mine)))
  $("hint").textContent = hint(mode, holder, mine, driver, replay)
  const pose = map.pose
  const sure = map.frame === "map" && map.sigma ? ` ± ${map.sigma.toFixed(2)} m` : ""
  $("where").textContent = map.lost ? "lost on the map" : pose
    ? `${map.frame}  x ${pose[0].toFixed(2)}  y ${pose[1].toFixed(2)} m${sure}  ${(pose[2] * 180 / Math.PI).toFixed(0)}°   grid ${map.step} m` : ""
  $("v-now").textContent = `${format(round(topics["/odom"]?.v))} m/s`
  $("w-now").textContent = `${format(round(topics["/odom"]?.omega))} rad/s`
  $("tabs").querySelector("[data-tab=fleet]").hidden = !topics["/fleet"]
  charts.forEach((chart) => chart.draw())
  lookAtCamera()
  camera.show()
  panels[tab](know, $("panel"))
  if ((know.page.replay || !(topics["/route"] ?? []).length) && drive.driving && routed) drive.arrived(), routed = false
  routed = (topics["/route"] ?? []).length > 0
}
let routed = false

// Why it moves nothing though it is armed, the remedy first.
const disobeys = (mode) => [
  mode?.panel?.manual && "c at the terminal: back to controller mode; in manual mode nothing drives it",
  mode?.power?.esc === false && "e at the terminal: switch the ESC on; it is off, so nothing moves",
].filter(Boolean)

// As the board's buzzer: without a pause while the link is lost, else by the batteries' state; s on, and s off.
const BEEPS = { warning: 2, bad: 1 }
const buzzer = (alive, state, time) => !alive || time % (2 * (BEEPS[state] ?? 0)) < BEEPS[state]

const round = (value) => (value === undefined ? NaN : Math.round(value * 100) / 100)

function battery(state, range) {
  if (!state?.state) return "–"
  if (state.state === "external power") return "external"
  const volts = Math.max(state.battery1 ?? 0, state.battery2 ?? 0).toFixed(1)
  if (state.remaining == null) return `${volts} V`
  return `${volts} V, ${Math.round(state.remaining / 60)} min` + (range == null ? "" : `, ${range} m`)
}

function hint(mode, holder, mine, driver, replay) {
  if (replay) return "This is a recording: nothing here moves the robot, but STOP stops it."
  if (!mode) return "Waiting for the robot."
  if (!mode.armed) return know.page.role === "visitor" ? "The robot is not armed, which is the operator's to do." : mode.remote ? "The robot is not armed, which is done at the robot itself." : "The robot is not armed: hold the button above for half a second."
  if (holder && !mine) return `Page ${holder} drives. You watch; STOP works all the same.`
  if (driver === "policy") return "A taught policy drives. Hold the stick to take over; it goes on when you let go."
  if (driver && driver !== "web" && driver !== "route") return `'${driver}' drives. It is your turn when it lets go.`
  return "Hold the stick to drive, let go to stop. Keys: w a s d, space stops."
}

function driving(by) {
  $("stick").dataset.by = by
}

function robots() {
  const { fleet = [], robots = {}, robot = "" } = know.page
  const list = [...(fleet.length ? fleet : [know.name || "robot"]).map((name) => [name, name]), ...Object.entries(robots)]
  const select = $("robots"), text = JSON.stringify(list)
  if (select.dataset.list !== text) {
    select.dataset.list = text
    select.replaceChildren(...list.map(([name, value]) => element("option", { value }, name)))
  }
  select.value = fleet.length ? robot : list[0][1]
}

function toast(text) {
  const made = element("p", {}, text)
  $("toasts").append(made)
  while ($("toasts").childElementCount > 3) $("toasts").firstElementChild.remove()
  setTimeout(() => made.remove(), TOAST)
}

// -- what is pressed

function setSpeed(value) {
  drive.speed = value
  $("speed").value = value
  $("speed-value").textContent = $("speed").ariaValueText = `${value.toFixed(1)} m/s`
}

// No faster than the car, nor than this page may drive it.
function limitSpeed() {
  const limit = Math.min(know.page.limit ?? Infinity, drive.hand?.v_max ?? Infinity)
  if (limit < Infinity) $("speed").max = limit
  if (drive.speed > limit) setSpeed(limit)
}

function changeSpeed(by) {
  setSpeed(Math.min(Number($("speed").max), Math.max(0.1, Math.round(10 * (drive.speed + by)) / 10)))
}

function marking(on) {
  $("waypoints").setAttribute("aria-pressed", String(on))
  if (!on) map.waypoints = []
  tools()
}

function tools() {
  const some = map.waypoints.length > 0
  $("go").hidden = $("clear").hidden = !some
  $("here").hidden = !some || know.page.role === "visitor" || map.waypoints.length > 2 || map.frame !== "map"
}

$("stop").addEventListener("pointerdown", () => drive.stop())
$("stop").addEventListener("click", () => drive.stop())
$("take").addEventListener("click", () => {
  const mine = know.page.wheel === know.page.number
  drive.letGo()
  link.send({ do: mine ? "give" : "take" })
})
$("camera-picture").addEventListener("click", () => $("camera").classList.toggle("large"))
$("speed").addEventListener("input", () => setSpeed($("speed").valueAsNumber))
$("robots").addEventListener("change", () => {
  const chosen = $("robots").value
  if (Object.values(know.page.robots ?? {}).includes(chosen)) location.href = chosen
  else {
    drive.letGo()
    sessionStorage.setItem("robot", chosen)
    link.send({ do: "robot", name: chosen })
  }
})
$("follow").addEventListener("click", () => {
  map.follow = !map.follow
  $("follow").setAttribute("aria-pressed", String(map.follow))
})
$("waypoints").addEventListener("click", () => marking($("waypoints").getAttribute("aria-pressed") !== "true"))
$("clear").addEventListener("click", () => marking(false))
$("go").addEventListener("click", () => {
  drive.go(map.waypoints, drive.speed)
  marking(false)
})
$("here").addEventListener("click", () => {
  link.command({ do: "here", points: map.waypoints })
  marking(false)
})
$("map").addEventListener("pointerup", (event) => {
  if ($("waypoints").getAttribute("aria-pressed") !== "true") return
  const box = $("map").getBoundingClientRect()
  map.waypoints.push(map.place(event.clientX - box.left, event.clientY - box.top))
  tools()
})
$("tabs").addEventListener("click", ({ target }) => {
  if (!target.dataset.tab) return
  tab = target.dataset.tab
  for (const each of $("tabs").children) each.setAttribute("aria-selected", String(each === target))
  $("panel").replaceChildren()
  $("panel").ariaLabel = target.textContent
  if (tab === "files") link.send({ do: "files" })
  subscribe()
  show()
})
$("theme").addEventListener("click", () => {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches
  const now = document.documentElement.dataset.theme ?? (dark ? "dark" : "light")
  document.documentElement.dataset.theme = now === "dark" ? "light" : "dark"
  localStorage.setItem("theme", document.documentElement.dataset.theme)
  repaint()
})
function repaint() {
  map.repaint()
  charts.forEach((chart) => chart.repaint())
  know.plot.chart?.repaint()
  know.learning.charts?.forEach((chart) => chart.repaint())
}
const theme = localStorage.getItem("theme")
if (theme) document.documentElement.dataset.theme = theme
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint)

setSpeed(0.5)
show()
setInterval(show, 100)
setInterval(() => {
  know.fps = map.frames
  map.frames = 0
  if (sensorTopics().length !== know.drawn) know.drawn = sensorTopics().length, subscribe()
}, 1000)

const KEPT = "view"  // of the map, and the tab: they outlive a reload
addEventListener("pagehide", () => sessionStorage.setItem(KEPT, JSON.stringify({ map: map.kept(), tab })))
const kept = JSON.parse(sessionStorage.getItem(KEPT) ?? "null")
if (kept) {
  map.restore(kept.map)
  $("follow").setAttribute("aria-pressed", String(map.follow))
  $("tabs").querySelector(`[data-tab="${kept.tab}"]:not([hidden])`)?.click()
}
