// navigator.serial of a page without hardware: its one port is a socket to a relay, which has the board's line.

class FakePort {
  getInfo() { return { usbVendorId: 0x2341, usbProductId: 0x43 } }

  async open({ baudRate }) {
    this.signals = null
    const socket = this.socket = new WebSocket(`RELAY?baud=${baudRate}`)
    socket.binaryType = "arraybuffer"
    await new Promise((resolve, reject) => {
      socket.onopen = resolve
      socket.onerror = () => reject(new DOMException("Failed to open serial port.", "NetworkError"))
    })
    this.readable = new ReadableStream({
      start: (controller) => {
        socket.onmessage = ({ data }) => controller.enqueue(new Uint8Array(data))
        socket.onclose = () => {
          this.readable = null
          controller.error(new DOMException("The device has been lost.", "NetworkError"))
        }
      },
    })
    this.taking = this.made()
  }

  // A stream that was aborted is followed by a new one, as the specification has it.
  get writable() { return this.taking }

  made() {
    return new WritableStream({
      write: (bytes, { signal }) => {
        if (!this.signals) throw new Error("a byte before DTR and RTS were set")
        // a port that takes no more bytes, until the write is aborted
        if (globalThis.portIsStuck) return new Promise((_, reject) => { signal.onabort = () => reject(signal.reason) })
        this.socket.send(bytes)
      },
      abort: () => {
        globalThis.portIsStuck = false
        this.taking = this.made()
      },
    })
  }

  async setSignals(signals) { this.signals = signals }

  async close() { this.socket.close() }
}

const ports = [new FakePort()]
Object.defineProperty(navigator, "serial", {
  value: { requestPort: async () => ports[0], getPorts: async () => ports },
  configurable: true,
})
