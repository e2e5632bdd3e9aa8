// The page without a server: it starts the robot's worker, gives the page its line to it, and shows what only a browser
// needs: how far loading is, learning, a board at a serial port, a program, files.

import { element } from "./panels.js"

const HANGS = 10000  // ms without a word of the robot's worker after which it is ended

const $ = (id) => document.getElementById(id)
const query = new URLSearchParams(location.search)
const kept = new Map()  // by name the recordings, in parts, and whether they are still written
let worker = null, guard = null, ready = false, lastHeard = 0

// What the page's link takes for a socket.
class WorkerSocket {
  readyState = WebSocket.CONNECTING

  begin() {
    this.readyState = WebSocket.OPEN
    worker.postMessage({ do: "open" })
    this.onopen()
  }

  send(data) { worker.postMessage({ do: "text", data }) }

  end() {
    this.readyState = WebSocket.CLOSED
    this.onclose()
  }
}

let socket = null
globalThis.robotSocket = () => {
  socket = new WorkerSocket()
  // not before whoever makes it has set its functions
  if (ready) queueMicrotask(() => socket.begin())
  return socket
}

// -- the worker

// Start a robot; the one before it stops first, and its recording is complete then.
function begin({ serial = false, learn } = {}) {
  hangUp()
  const line = serial ? new MessageChannel() : null
  if (serial) guard.postMessage({ do: "line", line: line.port1 }, [line.port1])
  if (!worker) {
    worker = new Worker("worker.js", { type: "module" })
    worker.onmessage = ({ data }) => heard(data)
    worker.onerror = (event) => failed(`the robot's worker failed: ${event.message}`)
    for (const [name, { parts }] of kept) worker.postMessage({ do: "write", name, file: new Blob(parts) })
  }
  const message = { do: "begin", settings: query.getAll("set"), learn, line: line?.port2 }
  worker.postMessage(message, line ? [line.port2] : [])
}

function hangUp() {
  ready = false
  const ended = socket
  socket = null
  ended?.end()
}

// A worker that hangs or has failed is ended. The next one gets what it recorded.
function failed(why) {
  worker?.terminate()
  worker = null
  hangUp()
  for (const each of kept.values()) each.open = false
  show(`${why}; ${guard ? "its board gets zeros" : "the car stands"}, and "start again" keeps what was recorded`, true)
}

// Ask the robot's worker for something; a new one if there is none.
function ask(message) {
  if (!worker) begin()
  worker.postMessage(message)
}

function heard(message) {
  lastHeard = performance.now()
  if (message.text) socket?.onmessage({ data: message.text })
  else if (message.kept) keep(message)
  else if (message.ready) {
    ready = true
    $("lost").style.visibility = ""
    show(isSecureContext ? "" : "a board, and use without a network, need https or localhost in the address")
    // only now: it loads all files once more
    navigator.serviceWorker?.register("offline.js").catch(() => {})
    socket?.begin()
  } else show(message.loading ?? message.why, message.bad)
}

if (navigator.serviceWorker) navigator.serviceWorker.onmessage = ({ data }) => show(data, true)

setInterval(() => {
  const silent = performance.now() - lastHeard
  if (ready && !document.hidden && silent > HANGS) failed(`the robot's worker has hung for ${HANGS / 1000} s and was ended`)
}, 1000)

// -- what is shown

function show(text, bad = false) {
  const bar = $("browser-state")
  bar.hidden = !text
  bar.classList.toggle("bad", bad)
  bar.textContent = text
}

const tool = (id, text, onclick) =>
  element("button", { id, onclick, style: "min-height: 32px; padding: 2px 9px; font-size: 13px" }, text)
// in the head, as a phone's page scrolls below it
$("stop").after(element("p", { id: "browser-state", role: "status", hidden: true, style: "flex: 1 1 100%; order: 9; margin: 0" }))
$("stop").parentElement.style.flexWrap = "wrap"
// that there is no news of a robot which has never been there alarms nobody
$("lost").style.visibility = "hidden"
$("hint").after(
  element("div", { id: "browser-tools", style: "display: flex; flex-wrap: wrap; gap: 8px" },
    tool("board", "connect a board", board),
    tool("learn", "let it learn", learn),
    tool("perform", "run a program", program),
    tool("restart", "start again", () => begin()),
    tool("load", "open a file", () => $("pick").click()),
    tool("verify", "verify the newest", verify)),
  element("input", { id: "pick", type: "file", accept: ".mcap", hidden: true, onchange: take }),
  element("textarea", { id: "program", hidden: true, rows: 4, spellcheck: false, ariaLabel: "program", style: "width: 100%" },
    "for each in range(4):\n    await robot.drive(v=0.5, omega=0.6, duration=2.0)\n    await asyncio.sleep(0.5)\n"))

// The thesis's learner drives, and its panel shows how.
function learn() {
  begin({ learn: "thesis" })
  $("program").hidden = true
  document.querySelector("[data-tab=learner]").click()
}

// The first click shows the program, the next ones run it, within the robot's worker.
function program() {
  if (!$("program").hidden) ask({ do: "program", code: $("program").value })
  $("program").hidden = false
}

// -- files

function keep({ kept: name, at, bytes, open }) {
  if (!at) kept.set(name, { parts: [] })
  const file = kept.get(name)
  file.parts.push(bytes)
  file.open = open
}

function take({ target }) {
  const [file] = target.files
  if (file) ask({ do: "write", name: file.name, file })
  target.value = ""
  document.querySelector("[data-tab=files]").click()
}

// A link to a recording leads to what was kept of it.
addEventListener("click", ({ target }) => {
  const link = target.closest?.("a[download]"), file = kept.get(link?.download)
  if (!file) return
  const url = link.href = URL.createObjectURL(new Blob(file.parts))
  setTimeout(() => URL.revokeObjectURL(url), 10000)
}, true)

// Run the newest recording's inputs again in a worker of its own, and compare.
async function verify() {
  const name = [...kept.keys()].findLast((each) => !kept.get(each).open)
  if (!name) return show("no recording is complete yet: start again completes the present one", true)
  const other = new Worker("worker.js", { type: "module" }), lines = []
  other.onmessage = ({ data: { loading, line, why, code } }) => {
    if (line) lines.push(line)
    if (why === undefined && code === undefined) return show(line ?? loading)
    other.terminate()
    show(why ?? lines.find((each) => each.includes("difference")) ?? lines.at(-1), code !== 0)
    $("browser-state").dataset.code = code
  }
  other.postMessage({ do: "perform", words: ["replay", "--verify", name], name, file: new Blob(kept.get(name).parts) })
}

// -- a board at a serial port

async function board() {
  if (!navigator.serial) return show("this browser has no serial ports: take Chrome or Edge, over https or on localhost", true)
  let port
  try {
    port = await navigator.serial.requestPort()
  } catch {
    return show("no port was chosen", true)
  }
  const { usbVendorId = null, usbProductId = null } = port.getInfo()
  guard ??= new Worker("guard.js", { type: "module" })
  guard.postMessage({ do: "port", usbVendorId, usbProductId, baud: Number(query.get("baud") ?? 57600) })
  begin({ serial: true })
}

// A hidden, frozen or left page holds nothing: the board gets its stop from the guard, whatever the robot's worker does.
function stopBoard() { guard?.postMessage({ do: "stop" }) }
document.addEventListener("visibilitychange", () => document.hidden && stopBoard())
document.addEventListener("freeze", stopBoard)
addEventListener("pagehide", stopBoard)
addEventListener("blur", stopBoard)
$("stop").addEventListener("pointerdown", stopBoard)

// -- begin

if (typeof WebAssembly === "undefined") show("this browser cannot run the robot: it has no WebAssembly", true)
else begin({ learn: query.get("learn") ?? undefined })
await import("./app.js")
