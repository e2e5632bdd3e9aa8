// What stands on the tabs: each is a function of all that the page knows, which fills the panel.

import { Chart, format } from "./chart.js"

export function element(name, properties = {}, ...children) {
  const made = document.createElement(name)
  for (const [key, value] of Object.entries(properties)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value)
    else if (key in made) made[key] = value
    else made.setAttribute(key, value)
  }
  made.append(...children.filter((child) => child !== null && child !== undefined))
  return made
}

export function table(head, rows, numbers = []) {
  const kind = (index) => (numbers.includes(index) ? "n" : "")
  const cell = (value, index) => (value instanceof Node && value.nodeName === "TD" ? value : element("td", { className: kind(index) }, value))
  return element("table", {},
    head ? element("thead", {}, element("tr", {}, ...head.map((text, index) => element("th", { className: kind(index) }, text)))) : null,
    element("tbody", {}, ...rows.map((row) => element("tr", {}, ...row.map(cell)))))
}

const span = (text, className = "") => element("span", { className }, text)
const title = (text) => element("h2", {}, text)
const quiet = (text) => element("p", { className: "dim" }, text)
const milliseconds = (seconds) => (Number.isFinite(seconds) ? (1000 * seconds).toFixed(seconds < 0.01 ? 2 : 1) : "–")

// Leaves of a value that are numbers, with their paths.
export function leaves(value, path = "", found = []) {
  if (typeof value === "number") found.push([path, value])
  else if (typeof value === "boolean") found.push([path, Number(value)])
  else if (value && typeof value === "object" && found.length < 200) {
    for (const [name, each] of Object.entries(value)) leaves(each, path ? `${path}.${name}` : name, found)
  }
  return found
}

// counted among the faults, but no faults: the gate kept a value within its limits (txt1/tasks/diagnostics.py)
const LIMITED = new Set(["speed_clipped", "yaw_rate_clipped", "pwm_clipped", "motor_limited", "steering_limited"])

const events = (know, panel) => {
  const faults = Object.entries(know.topics["/faults"] ?? {}).filter(([name]) => !LIMITED.has(name))
  const said = (know.topics["/events"] ?? []).slice(-60).reverse()
  panel.replaceChildren(
    ...(faults.length ? [title("faults"), table(null, faults.map(([name, count]) => [name, span(count, "warn")]), [1]), title("events")] : []),
    said.length ? table(null, said.map(({ time, text }) => [element("td", { className: "t" }, `${time.toFixed(1)} s`), text])) : quiet("nothing yet"))
}

const fleet = (know, panel) => {
  const all = know.topics["/fleet"] ?? []
  if (!all.length) return panel.replaceChildren(quiet("no fleet; two robots on a network: txt1 run --name a --fleet, and the same with --name b"))
  const state = ({ alive, armed, reason, silent }) => !alive ? span("gone", "bad") : silent ? span(`waits for ${silent}`, "warn")
    : armed ? span("armed", "good") : span(reason || "disarmed", "warn")
  panel.replaceChildren(
    table(["robot", "state", "drives", "m/s", "heard"], all.map((one) => [
      one.name, state(one), one.driver || "–", one.alive ? format(Math.round(100 * one.v) / 100) : "–",
      one.age == null ? "here" : `${one.age.toFixed(1)} s ago`]), [3, 4]),
    know.topics["/fleet_stop"] ? element("p", {}, `stop of all: ${know.topics["/fleet_stop"]}`) : "", quiet("STOP stops all of them."))
}

const sensors = (know, panel) => {
  const all = know.topics["/sensors"] ?? []
  if (!all.length) return panel.replaceChildren(quiet("no sensors beside the encoders; a simulated laser: txt1 run --web --set sensors.laser.driver=sim_laser"))
  const trusted = Object.fromEntries((know.topics["/estimation"] ?? []).map((trust) => [trust.name, trust]))
  panel.replaceChildren(...all.flatMap((sensor) => [
    title(sensor.name),
    span(sensor.healthy ? "healthy" : sensor.reason || "not healthy", sensor.healthy ? "good" : "bad"),
    trusted[sensor.name]?.believed === false ? span(`, not believed: ${trusted[sensor.name].reason}`, "warn") : null,
    span(`  ${sensor.readings} readings${sensor.failures ? `, ${sensor.failures} failures` : ""}`, "dim"),
    table(null, Object.entries(sensor.values).slice(0, 24).map(([name, value]) => [name, format(value), sensor.units]), [1]),
  ]).filter((each) => each !== null))
}

const tasks = (know, panel) => {
  const all = know.topics["/tasks"] ?? []
  panel.replaceChildren(table(["task", "Hz", "cycles", "missed", "late p99, ms", "runs p99, ms"], all.map((task) => [
    task.name, task.rate ? format(task.rate) : "–", task.cycles, span(task.misses, task.misses ? "warn" : ""),
    milliseconds(task.lateness.p99), milliseconds(task.run_time.p99),
  ]), [1, 2, 3, 4, 5]), quiet("times in ms"))
}

const RECENT = 50  // decisions that a mean reward is of
const STATES = 32  // as many rows of a table can be read
const EPISODE = /^episode (\d+): (reached|lost) the light after ([\d.]+) s, best possible ([\d.]+) s/

// A taught policy: what it would do, and how sure it is; what it sees is on the map and in the picture.
const policy = (look, panel) => {
  const side = look.steering > 0 ? "left" : "right", sure = Math.max(0, 1 - look.doubt / look.stop)
  panel.replaceChildren(
    title("taught policy"),
    element("p", {}, span(look.state, look.state === "drives" ? "good" : "warn")),
    table(null, [
      ["would steer", `${Math.round(100 * Math.abs(look.steering))} % ${side}`], ["would drive", `${format(Math.round(100 * look.v) / 100)} m/s`],
      ["sure", `${Math.round(100 * sure)} %`], ["doubt", look.doubt.toFixed(3)],
      ["slower from a doubt of", look.slow.toFixed(3)], ["stands from a doubt of", look.stop.toFixed(3)],
    ], [1]),
    element("meter", { min: 0, max: 1, low: 0.34, optimum: 1, value: sure, ariaLabel: "how sure the policy is" }))
}

const learner = (know, panel) => {
  if (know.look) return policy(know.look, panel)
  const { learning } = know, { steps, episodes } = learning
  if (!steps.length && !episodes.size) return panel.replaceChildren(quiet(globalThis.robotSocket ? "nothing is being learned: press 'let it learn'" : "nothing is being learned: txt1 run --learn thesis --web"))
  const curve = (id, label) => element("canvas", { id, className: "low", role: "img", ariaLabel: label })
  if (!panel.querySelector("#episodes-chart")) {
    panel.replaceChildren(
      title("time to the light, in times of the best possible"), curve("episodes-chart", "time to the light of the last 32 episodes"),
      title(`mean reward of the last ${RECENT} decisions`), curve("rewards-chart", "mean reward over the last 400 decisions"),
      element("div", { id: "learner-now" }), title("values of the actions, by state"), element("div", { id: "learner-table" }), title("episodes"), element("div", { id: "learner-episodes" }))
    learning.charts = null
  }
  if (!learning.charts) {
    learning.charts = [
      new Chart(panel.querySelector("#episodes-chart"), ["robot"], 0, 32, " ep."), new Chart(panel.querySelector("#rewards-chart"), ["robot"], 0, 400, ""),
    ]
    learning.seen = learning.over = 0
  }
  const [times, rewards] = learning.charts, last = steps.at(-1)
  if (learning.over !== episodes.size) {
    learning.over = episodes.size
    times.clear()
    for (const text of episodes.values()) {
      const [, number, how, time, best] = text.match(EPISODE) ?? []
      if (number) times.add(Number(number), how === "reached" ? time / best : NaN)
    }
    panel.querySelector("#learner-episodes").replaceChildren(
      table(null, [...episodes.values()].slice(-30).reverse().map((text) => [text])))
  }
  if (learning.seen !== learning.decisions) {
    learning.seen = learning.decisions
    rewards.clear()
    const known = steps.map((step) => step.reward).filter(Number.isFinite).slice(-400 - RECENT)
    known.forEach((_, index) => rewards.add(index, mean(known.slice(Math.max(0, index + 1 - RECENT), index + 1))))
    if (last) panel.querySelector("#learner-now").replaceChildren(table(null, [
      ["episode", last.episode], ["state", last.state < 0 ? "–" : last.state], ["decisions seen", learning.decisions],
      ["values", last.values.map((value) => value.toFixed(2)).join("  ")],
    ], [1]))
    const rows = new Map(steps.filter(({ state }) => state >= 0).map(({ state, values }) => [state, values]))
    if (rows.size <= STATES) panel.querySelector("#learner-table").replaceChildren(table(
      ["state", ...(last?.values ?? []).map((_, action) => `action ${action}`)],
      [...rows].sort(([one], [other]) => one - other).map(([state, values]) => [state, ...values.map((value) => value.toFixed(2))]), [1, 2, 3]))
  }
  learning.charts.forEach((chart) => chart.draw())
}

const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length

const plot = (know, panel) => {
  if (!panel.querySelector("#plot-chart")) {
    const topic = element("select", { id: "plot-topic", ariaLabel: "topic", onchange: () => know.choose(topic.value, "") })
    const field = element("select", { id: "plot-field", ariaLabel: "value", onchange: () => know.choose(know.plot.topic, field.value) })
    panel.replaceChildren(topic, element("div", { className: "row" }, field), element("canvas", { id: "plot-chart", role: "img", ariaLabel: "the value over the last 20 seconds" }), element("p", { id: "plot-now" }))
    know.plot.chart = new Chart(panel.querySelector("#plot-chart"), ["robot"])
    for (const [time, value] of know.plot.points) know.plot.chart.add(time, value)
  }
  options(panel.querySelector("#plot-topic"), ["", ...know.choices()], know.plot.topic, "choose a topic")
  options(panel.querySelector("#plot-field"), know.plot.fields, know.plot.field, "no numbers yet")
  know.plot.chart.draw()
  panel.querySelector("#plot-now").textContent = know.plot.points.length ? `${format(know.plot.points.at(-1)[1])} ${know.plot.field}` : ""
}

function options(select, names, chosen, none) {
  const wanted = names.length ? names : [""]
  if (select.dataset.names !== wanted.join("\n") && document.activeElement !== select) {
    select.replaceChildren(...wanted.map((name) => element("option", { value: name }, name || none)))
    select.dataset.names = wanted.join("\n")
  }
  if (document.activeElement !== select) select.value = chosen
}

const gains = (know, panel) => {
  const inForce = know.topics["/gain_table"]
  const text = JSON.stringify(inForce ?? null)
  if (!inForce) return panel.replaceChildren(quiet("no gains are known"))
  if (panel.dataset.gains === text && panel.querySelector("form")) return
  panel.dataset.gains = text
  const box = (value, name) => element("input", { type: "number", step: "any", required: true, value, ariaLabel: name })
  const linear = ["kp", "ki", "kd"].map((name) => box(inForce.linear[name], `linear ${name}`))
  const angular = inForce.angular.map((set) => [box(set.v_max, "up to"), ...["kp", "ki", "kd"].map((name) => box(set.gains[name], `angular ${name}`))])
  const values = (boxes) => boxes.map((each) => each.valueAsNumber)
  const before = [Object.values(inForce.linear), inForce.angular.map((set) => [set.v_max, ...["kp", "ki", "kd"].map((name) => set.gains[name])])]
  const load = (wanted) => {
    const was = before.flat(2), names = [...linear, ...angular.flat()].map((each) => each.ariaLabel)
    const changes = wanted.flat(2).map((value, k) => (value === was[k] ? "" : `${names[k]}: ${was[k]} → ${value}`)).filter(Boolean)
    if (changes.length && !confirm(`Load these gains? The car drives by them at once.\n\n${changes.join("\n")}`)) return
    if (changes.length) know.gainsBefore = before
    know.send({ do: "gains", linear: wanted[0], angular: wanted[1] })
  }
  const undo = know.gainsBefore?.flat(2).length === before.flat(2).length ? know.gainsBefore : null
  panel.replaceChildren(element("form", {
    onsubmit: (event) => {
      event.preventDefault()
      load([values(linear), angular.map(values)])
    },
  },
  title("speed loop"), table(["Kp", "Ki", "Kd"], [linear]),
  title("yaw-rate loop, by speed"), table(["up to m/s", "Kp", "Ki", "Kd"], angular),
  element("div", { className: "row" }, element("button", { className: "primary" }, "load these gains"),
    undo && element("button", { type: "button", onclick: () => load(undo) }, "undo"), inForce.loaded ? span("in force", "good") : span("not loaded", "warn"))))
}

// whether a panel stays as it is: nothing has changed, or something in it is pressed, which would lose the click
const kept = (panel, name, text) => {
  if (panel.childElementCount && (panel.dataset[name] === text || panel.matches(":active"))) return true
  panel.dataset[name] = text
  return false
}

const files = (know, panel) => {
  const replay = know.page.replay, text = JSON.stringify([know.files, replay, know.topics["/recording"], know.page.role])
  if (kept(panel, "files", text)) return
  const now = know.topics["/recording"]
  const parts = [element("div", { className: "row" },
    replay || know.page.role === "visitor" ? null : element("button", { id: "record", className: now ? "" : "primary", onclick: () => know.send({ do: "record", on: !now }) }, now ? "stop recording" : "record"),
    element("button", { onclick: () => know.send({ do: "files" }) }, "Refresh"),
    now ? span(now, "dim") : null)]
  if (replay) {
    parts.push(title(`showing ${replay.name}`), element("div", { className: "row" },
      element("button", { id: "live", className: "primary", onclick: () => know.replay() }, "back to the robot"),
      element("button", { onclick: () => know.send({ do: "wind", speed: replay.speed ? 0 : 1 }) }, replay.speed ? "pause" : "play"),
      element("button", { onclick: () => know.send({ do: "wind", speed: 4 }) }, "4 ×")),
    element("input", {
      type: "range", min: replay.start, max: replay.end, step: 0.1, value: replay.position, style: "width:100%", ariaLabel: "position",
      oninput: (event) => know.send({ do: "wind", to: event.target.valueAsNumber }),
    }))
  }
  const all = know.files ?? []
  parts.push(title("recordings"), all.length ? table(null, all.map((file) => [
    element("td", {}, element("a", { href: `recordings/${file.name}`, download: file.name }, file.name),
      element("div", { className: "dim" }, `${new Date(1000 * file.time).toLocaleString()}, ${(file.size / 1e6).toFixed(1)} MB`)),
    element("td", { className: "n" }, element("button", { onclick: () => know.replay(file.name) }, "show")),
  ])) : quiet("none yet: the button above begins one"))
  panel.replaceChildren(...parts)
}

const page = (know, panel) => {
  const about = know.page, visitors = about.visitors
  const rows = [
    ["this page", `number ${about.number}, ${about.role}`], ["pages", about.pages],
    ["to the robot and back", about.round_trip == null ? "–" : `${milliseconds(about.round_trip)} ms`],
    ["frames a second", know.fps], ["commands late", about.counts?.late ?? 0],
    ["set-point", `${format(know.topics["/setpoint"]?.v)} m/s  ${format(know.topics["/setpoint"]?.omega)} rad/s`],
  ]
  const text = JSON.stringify(rows) + visitors
  if (kept(panel, "page", text)) return
  const parts = [table(null, rows, [1])]
  if (about.role === "operator") {
    const out = element("output", {}, `${visitors} m/s`)
    parts.push(title("visitors drive at most"), element("div", { className: "row" }, element("input", {
      id: "visitors", type: "range", min: 0.1, max: know.topics["/hand"]?.v_max ?? visitors, step: 0.1, value: visitors, ariaLabel: "visitors' speed",
      onchange: (event) => know.send({ do: "limit", speed: event.target.valueAsNumber }),
    }), out))
    if (about.invites) parts.push(element("img", { id: "invitation", src: "visitors.svg", alt: "code for visitors", width: 180, height: 180 }))
  }
  if (about.invites !== undefined && location.protocol === "https:") {
    parts.push(element("div", { className: "row" }, element("button", { onclick: () => know.signOut() }, "sign out")))
  }
  panel.replaceChildren(...parts)
}

export const panels = { events, fleet, sensors, tasks, learner, plot, gains, files, page }
