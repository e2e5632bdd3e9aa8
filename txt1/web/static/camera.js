// The camera's picture, by a socket of its own to a process of its own. The next picture comes when this one was drawn.
// Of each picture its age is known: from the exposure to now, on this page's clock.

const OLD = 0.3  // s: an older picture is greyed
const LOOKED = 10  // s over which the quickest message is searched for, twice
const PAUSES = [500, 1000, 2000, 5000]  // ms before each new try; the last goes on
const HEAD = 24  // bytes before the JPEG

const seconds = () => performance.now() / 1000

export class Camera {
  #socket = null
  #address = ""
  #tries = 0
  #opened = false  // whether it was ever open: else the browser may not trust the address
  #quickest = [Infinity, Infinity]  // smallest difference of this page's clock and the robot's, with the way; in the last s, and before
  #since = 0
  #way = 0  // s, half of the shortest round trip
  #exposed = null  // time of the picture's exposure on the robot's clock; null: it is not known
  #times = []  // when pictures came, s

  constructor({ card, canvas, age, trust }) {
    Object.assign(this, { card, canvas, caption: age, trust })
    document.addEventListener("visibilitychange", () => this.#begin())
  }

  // Look at a camera by its address, "" for none.
  look(address) {
    if (address === this.#address) return
    this.#address = address
    this.#exposed = null
    this.#opened = false
    this.#tries = 0
    this.#begin()
  }

  // Age of the picture, s; undefined if it is not known.
  get age() {
    if (this.#exposed === null) return undefined
    return seconds() - Math.min(...this.#quickest) + this.#way - this.#exposed
  }

  // Draw a picture of a recording or of another way: its age is not known.
  async paint(data) {
    this.#exposed = null
    await this.#draw(new Blob([data], { type: "image/jpeg" }))
  }

  forget() {
    this.#exposed = null
    this.card.hidden = true
  }

  // Tell the age, ten times a second.
  show() {
    const { age } = this, present = seconds()
    const old = age > OLD
    this.card.classList.toggle("old", old)
    this.#times = this.#times.filter((time) => time > present - 2)
    const lost = this.#address && this.#exposed === null && this.#tries > 1
    this.caption.textContent = age === undefined ? (lost ? "no picture" : "")
      : old ? `${age.toFixed(1)} s old` : `${Math.round(1000 * age)} ms, ${Math.round(this.#times.length / 2)} /s`
    this.trust.hidden = !lost || this.#opened || location.protocol !== "https:"
    this.trust.href = this.#address.replace(/^wss:(.*)\/camera\/.*/, "https:$1/")
    if (lost) this.card.hidden = false
  }

  #begin() {
    const before = this.#socket
    this.#socket = null
    before?.close()
    if (!this.#address || document.hidden) return
    const socket = new WebSocket(this.#address)
    this.#socket = socket
    socket.binaryType = "arraybuffer"
    socket.onopen = () => {
      this.#opened = true
      this.#tries = 0
      this.#quickest = [Infinity, Infinity]
    }
    socket.onmessage = ({ data }) => this.#take(socket, data)
    socket.onclose = () => {
      if (socket !== this.#socket) return
      this.#socket = null
      const pause = PAUSES[Math.min(this.#tries++, PAUSES.length - 1)]
      setTimeout(() => this.#socket ?? this.#begin(), pause)
    }
  }

  async #take(socket, data) {
    const arrived = seconds(), head = new DataView(data)
    const [exposed, sent, trip] = [0, 8, 16].map((at) => head.getFloat64(at, true))
    if (arrived > this.#since + LOOKED) {
      this.#quickest = [Infinity, this.#quickest[0]]
      this.#since = arrived
    }
    this.#quickest[0] = Math.min(this.#quickest[0], arrived - sent)
    this.#way = Number.isFinite(trip) ? trip / 2 : 0
    await this.#draw(new Blob([new Uint8Array(data, HEAD)], { type: "image/jpeg" }))
    if (socket !== this.#socket) return
    this.#exposed = exposed
    this.#times.push(seconds())
    if (socket.readyState === WebSocket.OPEN) socket.send("seen")
  }

  async #draw(blob) {
    try {
      const picture = await createImageBitmap(blob)
      const { canvas } = this
      if (canvas.width !== picture.width || canvas.height !== picture.height) [canvas.width, canvas.height] = [picture.width, picture.height]
      canvas.getContext("2d").drawImage(picture, 0, 0)
      picture.close()
      this.card.hidden = false
    } catch {}  // a damaged picture costs itself
  }
}
