// The guard of a board: it alone owns the serial port. It writes what the robot's worker sends; when that has said
// nothing for 0.1 s it writes zeros, again and again, also when that worker hangs or was ended. A stop of the page goes
// first: what waits is dropped, and nothing of the worker is written until the worker says that it has stopped.

const SILENCE = 100  // ms without a word of the robot's worker
const LOOK = 20      // ms between two looks
const PACE = 50      // ms between two zeros

let wanted = null, port = null, line = null
let zeros = null, heard = 0, zeroed = 0
let waiting = null, writing = false, writer = null
let stop = 0, obeyed = 0

const bytes = (text) => Uint8Array.from(text, (each) => each.charCodeAt(0))
const text = (data) => String.fromCharCode(...data)
const tell = (what, text = "") => line?.postMessage({ what, text })

// At most one message waits; a newer one takes its place.
async function write(data) {
  waiting = data
  if (writing || !writer) return
  writing = true
  try {
    while (waiting) {
      const next = waiting
      waiting = null
      await writer.write(next)
    }
  } catch {
    // the port is gone, which the reader tells, or the write was aborted by a stop
  }
  writing = false
}

async function open() {
  const ports = await navigator.serial.getPorts()
  port = ports.find((each) => {
    const { usbVendorId = null, usbProductId = null } = each.getInfo()
    return usbVendorId === wanted.usbVendorId && usbProductId === wanted.usbProductId
  })
  if (!port) return tell("refused", "the chosen port is not there any more; connect the board again")
  try {
    if (!port.readable) await port.open({ baudRate: wanted.baud, bufferSize: 4096 })
    // before the first byte: some boards start anew when these lines move
    await port.setSignals({ dataTerminalReady: true, requestToSend: true })
  } catch (error) {
    return tell("refused", `${error.message}; close other programs that use the port`)
  }
  writer = port.writable.getWriter()
  heard = performance.now()
  tell("opened")
  read()
}

async function read() {
  const reading = port
  let why = "the device was unplugged"
  while (reading.readable) {
    const reader = reading.readable.getReader()
    try {
      for (;;) {
        const { value, done } = await reader.read()
        if (done) break
        tell("read", text(value))
      }
      break
    } catch (error) {
      why = error.message
      if (error.name === "NetworkError") break  // unplugged; all else is noise on the line, and reading goes on
    } finally {
      reader.releaseLock()
    }
  }
  if (port === reading) await close(), tell("lost", why)
}

async function close() {
  const closing = port
  port = null
  waiting = null
  try {
    writer?.releaseLock()
    writer = null
    await closing?.close()
  } catch {
    // it is gone already
  }
}

async function stopNow() {
  stop++
  tell("stop", String(stop))
  waiting = null
  if (!port || !zeros) return
  if (writing) {
    try {
      await writer.abort()  // what the port has not taken yet
    } catch {}
    writer.releaseLock()
    writing = false
    writer = port.writable?.getWriter() ?? null
  }
  write(zeros)
}

setInterval(() => {
  const now = performance.now()
  if (port && zeros && now - heard > SILENCE && now - zeroed >= PACE) {
    zeroed = now
    write(zeros)
  }
}, LOOK)

const fromRobot = {
  open: (frame) => (zeros = bytes(frame), open()),
  write: (frame) => { if (obeyed === stop) write(waiting ? join(waiting, bytes(frame)) : bytes(frame)) },
  beat: () => {},
  obeyed: (number) => { obeyed = Number(number) },
  close: () => close(),
}

// Frames of one cycle go together; more than that is old.
function join(first, second) {
  if (first.length + second.length > 64) return second
  const both = new Uint8Array(first.length + second.length)
  both.set(first)
  both.set(second, first.length)
  return both
}

onmessage = async ({ data }) => {
  if (data.do === "port") {
    await close()
    wanted = data
  } else if (data.do === "line") {
    line = data.line
    // a new robot is disarmed; it has not heard of earlier stops, and cannot confirm them
    obeyed = stop
    line.onmessage = ({ data }) => {
      heard = performance.now()
      fromRobot[data.do](data.text)
    }
  } else if (data.do === "stop") stopNow()
}
