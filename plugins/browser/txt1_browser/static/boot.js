// The page without a server: it starts the robot's worker, gives the page its line to it, and shows what only a browser
// needs: how far loading is, learning, a board at a serial port, files.

const $ = (id) => document.getElementById(id)

// What the page's link takes for a socket.
class WorkerSocket {
  constructor() {
    this.readyState = 0
    sockets.add(this)
    // not before whoever makes it has set its functions
    if (ready) queueMicrotask(() => this.begin())
  }

  begin() {
    if (this.readyState) return
    this.readyState = 1
    worker.postMessage({ do: "open" })
    this.onopen?.()
  }

  send(data) { worker.postMessage({ do: "text", data }) }

  end() {
    if (this.readyState === 3) return
    this.readyState = 3
    sockets.delete(this)
    this.onclose?.()
  }
}
globalThis.robotSocket = () => new WorkerSocket()

const sockets = new Set()
const waiting = new Map()  // what was asked of the worker, by number
const HANGS = 10000  // ms without a word of the robot's worker after which it is ended
let worker = null, guard = null, ready = false, asked = 0, lastHeard = 0
const kept = new Map()  // the recordings so far, in parts, for when their worker is ended

const query = new URLSearchParams(location.search)

// -- the worker

// Start a robot; the one before it stops first, and its recording is complete then.
function begin({ hal = "sim", learn = null } = {}) {
  for (const each of [...sockets]) each.end()
  ready = false
  const transfer = [], message = { do: "begin", settings: query.getAll("set"), learn }
  if (hal === "serial") {
    const line = new MessageChannel()
    guard.postMessage({ do: "line", line: line.port1 }, [line.port1])
    message.line = line.port2
    transfer.push(line.port2)
  }
  if (!worker) {
    worker = new Worker("worker.js", { type: "module" })
    worker.onmessage = ({ data }) => heard(data)
    worker.onerror = (event) => failed(`the robot's worker failed: ${event.message}`)
    show("loading Python")
    for (const [name, parts] of kept) write(name, new Blob(parts))
  }
  worker.postMessage(message, transfer)
  lastHeard = performance.now()
}

// A worker that hangs or has failed is ended. The next one gets what it recorded.
function failed(why) {
  worker?.terminate()
  worker = null
  ready = false
  for (const each of [...sockets]) each.end()
  show(`${why}; ${guard ? "its board gets zeros" : "the car stands"}, and "start again" keeps what was recorded`, true)
}

function heard(message) {
  lastHeard = performance.now()
  if (message.text !== undefined) for (const each of sockets) each.onmessage?.({ data: message.text })
  else if (message.answer) waiting.get(message.answer)?.(message), waiting.delete(message.answer)
  else if (message.kept) keep(message)
  else if (message.loading) show(message.loading)
  else if (message.state === "ready") {
    ready = true
    show(isSecureContext ? "" : "a board, and use without a network, need https or localhost in the address")
    // only now: it loads all files once more
    navigator.serviceWorker?.register("offline.js").catch(() => {})
    for (const each of sockets) each.begin()
  } else if (message.state === "told" || message.state === "failed") show(message.why, true)
}

if (navigator.serviceWorker) navigator.serviceWorker.onmessage = ({ data }) => show(data, true)

function keep({ kept: name, at, bytes }) {
  if (!at) kept.set(name, [])
  kept.get(name).push(bytes)
}

setInterval(() => {
  const silent = performance.now() - lastHeard
  if (worker && ready && !document.hidden && silent > HANGS) failed(`the robot's worker has hung for ${HANGS / 1000} s and was ended`)
}, 1000)

// Perform a command of txt1 in a worker of its own, with recordings of the robot's worker; returns the lines it prints.
async function perform(words, names, each) {
  const files = []
  for (const name of names) files.push({ name, bytes: (await ask({ do: "read", name })).bytes })
  const other = new Worker("worker.js", { type: "module" })
  return new Promise((resolve) => {
    other.onmessage = ({ data }) => {
      if (data.line) each(data.line)
      if (data.loading) each(data.loading)
      if (data.state) each(data.why)
      if (data.code === undefined && !data.state) return
      other.terminate()
      resolve(data.code ?? 1)
    }
    other.postMessage({ do: "perform", words, files })
  })
}

// Ask the worker for something that it answers once.
function ask(request, transfer = []) {
  return new Promise((resolve) => {
    waiting.set(++asked, resolve)
    worker.postMessage({ ...request, number: asked }, transfer)
  })
}

// -- what is shown

function show(text, bad = false) {
  const bar = $("browser-state")
  bar.hidden = !text
  bar.classList.toggle("bad", bad)
  bar.firstElementChild.textContent = text
  bar.lastElementChild.hidden = !bad
}

function make(tag, attributes, ...children) {
  const made = Object.assign(document.createElement(tag), attributes)
  made.append(...children)
  return made
}

const again = make("button", { className: "plain", textContent: "start again", onclick: () => begin() })
$("reason").before(make("p", { id: "browser-state", role: "status", hidden: true }, make("span", {}), again))
const pick = make("input", { id: "pick", type: "file", accept: ".mcap", hidden: true, onchange: take })
$("hint").after(make("div", { id: "browser-tools", style: "display: flex; flex-wrap: wrap; gap: 8px" },
  make("button", { id: "board", textContent: "connect a board", onclick: board }),
  make("button", { id: "learn", textContent: "let it learn", title: "it learns to find the light", onclick: learn }),
  make("button", { id: "perform", textContent: "run a program", onclick: program }),
  make("button", { id: "restart", textContent: "start again", onclick: () => begin() }),
  make("button", { id: "load", textContent: "open a file", onclick: () => pick.click() }),
  make("button", { id: "verify", textContent: "verify the newest", onclick: verify })), pick,
  make("textarea", { id: "program", hidden: true, rows: 8, spellcheck: false, ariaLabel: "program", style: "width: 100%", value:
    "for each in range(4):\n    await robot.drive(v=0.5, omega=0.6, duration=2.0)\n    await asyncio.sleep(0.5)\n" }))

// The thesis's learner drives, and its panel shows how.
function learn() {
  begin({ learn: "thesis" })
  document.querySelector("[data-tab=learner]").click()
}

// The first click shows the program, the next ones run it, within the robot's worker.
function program() {
  if (!$("program").hidden) worker.postMessage({ do: "program", code: $("program").value })
  $("program").hidden = false
}

// -- files

async function take() {
  const [file] = pick.files
  if (file) await write(file.name, file)
  pick.value = ""
}

async function write(name, blob) {
  const bytes = await blob.arrayBuffer()
  const { why } = await ask({ do: "write", name, bytes }, [bytes])
  show(why, Boolean(why))
}

// Run the newest recording's inputs again, and compare.
async function verify() {
  const { names } = await ask({ do: "list" })
  const whole = names.filter(({ open }) => !open)
  if (!whole.length) return show("no recording is complete yet: start again completes the present one", true)
  const lines = []
  const code = await perform(["replay", "--verify", whole[0].name], [whole[0].name], (line) => {
    lines.push(line)
    show(line)
  })
  show(lines.find((line) => line.includes("difference")) ?? lines.at(-1), true)
  $("browser-state").dataset.code = code
}

addEventListener("click", async (event) => {
  const link = event.target.closest?.("a[download]")
  if (!link || link.href.startsWith("blob:")) return
  event.preventDefault()
  const { bytes, why } = await ask({ do: "read", name: link.download })
  if (why) return show(why, true)
  const url = URL.createObjectURL(new Blob([bytes], { type: "application/octet-stream" }))
  make("a", { href: url, download: link.download }).click()
  setTimeout(() => URL.revokeObjectURL(url), 10000)
}, true)

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
  guard.onmessage = ({ data }) => data.why && show(data.why, true)
  guard.postMessage({ do: "port", usbVendorId, usbProductId, baud: Number(query.get("baud") ?? 57600) })
  begin({ hal: "serial" })
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
else begin({ learn: query.get("learn") })
await import("./app.js")
