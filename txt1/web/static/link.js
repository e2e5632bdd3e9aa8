// The socket to the robot: telemetry in, requests out. It reconnects by itself. Of what was asked for before, it sends
// only a stop that the server has not confirmed: a stop is as good later as it is now.

//
// A packet that is lost holds up all that follows it on its connection. So there are connections for stops alone, the stop
// channels: a stop is sent on all, and again until it is confirmed, as repetitions show TCP a loss early. Without the
// channels the socket does everything.

const PAUSES = [200, 500, 1000, 2000]  // ms before each new try; the last goes on
const AGAIN = 30  // ms after which a stop is sent again
const CHANNELS = 2
const COPIES = 10  // of a stop on a connection; after that TCP's own repetitions have to do

function serverSocket(name) {
  const scheme = location.protocol === "https:" ? "wss" : "ws"
  return new WebSocket(`${scheme}://${location.host}${new URL(name, location.href).pathname}`)
}

export class Link {
  #socket = null
  #channels = new Set()  // for stops
  #copies = null  // timer of the next copy of a stop
  #number = 0
  #tries = 0
  #stop = 0  // counts stops; each is numbered
  #asked = 0  // when the stop that waits for its confirmation was asked for, ms of this page; 0: none waits
  heard = 0  // when telemetry came last, ms of this page

  // `telemetry` takes snapshots, `message` all else, `change` whether it is open
  constructor({ telemetry, message, change }) {
    this.telemetry = telemetry
    this.message = message
    this.change = change
    this.#open()
  }

  get open() { return this.#socket?.readyState === WebSocket.OPEN }

  // For how long a stop has waited for the server to confirm that it has come, ms.
  get waiting() { return this.#asked ? performance.now() - this.#asked : 0 }

  // A request for now: without a connection it is dropped.
  send(request) {
    if (this.open) this.#socket.send(JSON.stringify(request))
  }

  // A command: with a number, and the time of its origin on this page's clock, so that a late one is seen to be late.
  command(request, time = performance.now()) {
    this.send({ ...request, n: ++this.#number, t: time / 1000 })
  }

  // Stop the robot. Without a connection, or with one that breaks first, the stop is sent as soon as there is another.
  stop() {
    this.#stop++
    this.#asked ||= performance.now()
    this.#sendStop(COPIES)
  }

  #sendStop(copies) {
    clearTimeout(this.#copies)
    if (!this.#asked) return
    for (const socket of [...this.#channels, this.#socket])
      if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ do: "stop", stop: this.#stop }))
    if (copies > 1) this.#copies = setTimeout(() => this.#sendStop(copies - 1), AGAIN)
  }

  #confirmed({ stop }) {
    if (stop === this.#stop) this.#asked = 0
  }

  #openChannels() {
    while (this.#channels.size < CHANNELS) this.#openChannel()
  }

  // One that is refused is tried again when the socket opens the next time, so that many pages do not ask all the time.
  #openChannel() {
    const channel = serverSocket("stop")
    this.#channels.add(channel)
    channel.onopen = () => {
      channel.onclose = () => {
        this.#channels.delete(channel)
        setTimeout(() => this.#openChannels(), PAUSES.at(-1))
      }
      this.#sendStop(COPIES)
    }
    channel.onmessage = ({ data }) => this.#confirmed(JSON.parse(data))
    channel.onclose = () => this.#channels.delete(channel)
  }

  #open() {
    const socket = this.#socket = globalThis.robotSocket?.() ?? serverSocket("socket")
    socket.onopen = () => {
      this.#tries = 0
      this.#sendStop(COPIES)
      if (!globalThis.robotSocket) this.#openChannels()  // a robot within the browser has no server
      this.change(true)
    }
    socket.onmessage = (event) => {
      const message = JSON.parse(event.data)
      if (message.ping !== undefined) this.send({ do: "pong", ping: message.ping, t: performance.now() / 1000 })
      this.#confirmed(message)
      if (message.topics) {
        this.heard = performance.now()
        this.telemetry(message)
      }
      else this.message(message)
    }
    socket.onclose = () => {
      const pause = PAUSES[Math.min(this.#tries++, PAUSES.length - 1)]
      this.change(false)
      setTimeout(() => this.#again(), pause)
    }
  }

  async #again() {
    try {  // whoever is signed out finds the door in place of the page
      const page = await fetch("./", { cache: "no-store" })
      if (page.ok && (await page.text()).includes("sign-in.js")) return location.reload()
    } catch {}
    this.#open()
  }
}
