// The robot's worker: loads Python, runs the robot's loop, and carries texts between the page and the robot.

import { loadPyodide } from "./pyodide/pyodide.mjs"

let python = null, robot = null, timer = 0

async function load() {
  postMessage({ loading: "loading Python" })
  python = await loadPyodide({ indexURL: new URL("pyodide/", location.href).href })
  postMessage({ loading: "loading txt1" })
  const packages = await (await fetch("packages.zip")).arrayBuffer()
  python.unpackArchive(packages, "zip", { extractDir: "/packages" })
  postMessage({ loading: "starting the robot" })
  python.runPython("import sys; sys.path.insert(0, '/packages')\nfrom txt1_browser.lacking import stand_in; stand_in()")
}

// The loop's next turn, after ms; a MessageChannel for short waits, as timers wait for 4 ms at least.
const soon = new MessageChannel()
soon.port1.onmessage = () => turn()
function turn() {
  clearTimeout(timer)
  const pause = robot.turn()
  if (pause < 0) return
  if (pause < 1) soon.port2.postMessage(0)
  else timer = setTimeout(turn, pause)
}

const bytesOf = (file) => new Uint8Array(new FileReaderSync().readAsArrayBuffer(file))

const acts = {
  begin({ settings, learn, line }) {
    if (line) line.onmessage = ({ data }) => {
      robot.heard(data.what, data.text)
      turn()
    }
    robot.begin(python.toPy(settings), line && ((what, text) => line.postMessage({ do: what, text })), learn)
  },
  open: () => robot.open(),
  text: ({ data }) => robot.receive(data),
  program: ({ code }) => robot.perform(code),
  write: ({ name, file }) => robot.keep(name, python.toPy(bytesOf(file)).tobytes()),
}

// A command in this worker, which does nothing else.
function perform({ words, name, file }) {
  python.FS.writeFile(name, bytesOf(file))
  const { perform } = python.pyimport("txt1_browser.command_worker")
  postMessage({ code: perform(python.toPy(words), (line) => postMessage({ line })) })
}

function act(message) {
  if (message.do === "perform") return perform(message)
  robot ??= python.pyimport("txt1_browser.robot_worker").RobotWorker(
    (text) => postMessage({ text }),
    (why, bad) => postMessage(why ? { why, bad } : { ready: true }),
    (kept, at, bytes, open) => postMessage({ kept, at, bytes: bytes.toJs(), open }),
  )
  acts[message.do](message)
  turn()
}

const loaded = load()
onmessage = ({ data }) => {
  loaded.then(() => act(data)).catch((error) => postMessage({ why: `Python failed: ${error.message}`, bad: true }))
}
