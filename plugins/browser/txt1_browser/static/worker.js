// The robot's worker: loads Python, runs the robot's loop, and carries texts between the page and the robot.

import { loadPyodide } from "./pyodide/pyodide.mjs"

let robot = null, python = null, timer = 0
const early = []  // what came before the robot was there

async function load() {
  postMessage({ loading: "loading Python" })
  python = await loadPyodide({ indexURL: new URL("pyodide/", location.href).href })
  postMessage({ loading: "loading txt1" })
  const packages = await (await fetch("packages.zip")).arrayBuffer()
  python.unpackArchive(packages, "zip", { extractDir: "/packages" })
  postMessage({ loading: "starting the robot" })
  python.runPython("import sys; sys.path.insert(0, '/packages')\nfrom txt1_browser.lacking import stand_in; stand_in()")
}

async function begin({ settings, line, learn }) {
  if (!robot) {
    await load()
    const { RobotWorker } = python.pyimport("txt1_browser.robot_worker")
    const keep = (name, at, bytes) => postMessage({ kept: name, at, bytes: bytes.toJs() })
    robot = RobotWorker((text) => postMessage({ text }), (state, why) => postMessage({ state, why }), keep)
  } else robot.end()
  const send = line && ((what, text) => line.postMessage({ do: what, text }))
  if (line) line.onmessage = ({ data }) => {
    robot.heard(data.what, data.text)
    turn()
  }
  robot.begin(python.toPy(settings), send, learn ?? undefined)
  for (const message of early.splice(0)) act(message)
  turn()
}

// A command in this worker, which does nothing else.
async function perform({ words, files }) {
  await load()
  for (const { name, bytes } of files) python.FS.writeFile(name, bytes)
  const { perform } = python.pyimport("txt1_browser.command_worker")
  postMessage({ code: perform(python.toPy(words), (line) => postMessage({ line })) })
}

// The loop's next turn, after ms; a MessageChannel for short waits, as timers wait for 4 ms at least.
const soon = new MessageChannel()
soon.port1.onmessage = () => turn()
function turn() {
  clearTimeout(timer)
  timer = 0
  const pause = robot.turn()
  if (pause < 0) return
  if (pause < 1) soon.port2.postMessage(0)
  else timer = setTimeout(turn, pause)
}

const acts = {
  open: () => robot.open(),
  text: ({ data }) => robot.receive(data),
  program: ({ code }) => robot.perform(code),
  read: ({ name, number }) => {
    try {
      postMessage({ answer: number, bytes: python.FS.readFile(`/recordings/${name}`) })
    } catch {
      postMessage({ answer: number, why: `${name}: there is no such recording any more` })
    }
  },
  list: ({ number }) => postMessage({ answer: number, names: robot.recordings().toJs({ dict_converter: Object.fromEntries }) }),
  write: ({ name, bytes, number }) => postMessage({ answer: number, why: robot.keep(name, python.toPy(new Uint8Array(bytes)).tobytes()) }),
}

function act(message) {
  acts[message.do](message)
  turn()
}

const failed = (error) => postMessage({ state: "failed", why: `Python failed: ${error.message}` })

onmessage = ({ data }) => {
  if (data.do === "begin") begin(data).catch(failed)
  else if (data.do === "perform") perform(data).catch(failed)
  else if (robot) act(data)
  else early.push(data)
}
