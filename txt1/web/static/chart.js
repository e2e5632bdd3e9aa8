// Curves over the last 20 seconds, or over as many decisions and the like.

import { colours } from "./map.js"

const SPAN = 20  // s

export class Chart {
  #points = []  // [time, value, ...]
  #colours = null

  // `series` are the names of the colours; the axis reaches at least `reach` to both sides, or to the data if 0;
  // `span` is how much is shown of what goes to the right, in `unit`
  constructor(canvas, series, reach = 0, span = SPAN, unit = " s") {
    this.canvas = canvas
    this.series = series
    this.reach = reach
    this.span = span
    this.unit = unit
  }

  repaint() { this.#colours = null }

  clear() { this.#points = [] }

  add(time, ...values) {
    const last = this.#points.at(-1)
    if (last && time < last[0]) this.#points = []
    if (last && time === last[0]) return
    this.#points.push([time, ...values])
    while (this.#points[0][0] < time - this.span) this.#points.shift()
  }

  draw() {
    const { canvas } = this, c = canvas.getContext("2d")
    const density = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight
    if (!width || !height) return
    if (canvas.width !== Math.round(width * density)) canvas.width = Math.round(width * density)
    if (canvas.height !== Math.round(height * density)) canvas.height = Math.round(height * density)
    this.#colours ??= colours(canvas)
    c.setTransform(density, 0, 0, density, 0, 0)
    c.clearRect(0, 0, width, height)
    const known = this.#points.flatMap((point) => point.slice(1)).filter(Number.isFinite)
    let low = Math.min(-this.reach, ...known), high = Math.max(this.reach, ...known)
    if (!known.length && !this.reach) return
    if (high - low < 1e-9) [low, high] = [low - 1, high + 1]
    const margin = 0.06 * (high - low)
    ;[low, high] = [low - margin, high + margin]
    const left = 44, bottom = height - 15, end = this.#points.at(-1)?.[0] ?? 0
    const px = (time) => left + (width - left - 4) * (1 - (end - time) / this.span)
    const py = (value) => 3 + (bottom - 3) * (high - value) / (high - low)
    c.font = "11px system-ui, sans-serif"
    c.lineWidth = 1
    c.textAlign = "right"
    c.textBaseline = "middle"
    for (const value of ticks(low, high, Math.max(2, Math.floor(height / 20)))) {
      c.strokeStyle = this.#colours.grid
      line(c, [[left, py(value)], [width, py(value)]])
      c.fillStyle = this.#colours.dim
      c.fillText(format(value), left - 5, Math.min(bottom - 4, Math.max(7, py(value))))
    }
    c.textBaseline = "alphabetic"
    for (let age = 0; age <= this.span; age += this.span / 4) {
      c.textAlign = age ? "center" : "right"
      c.fillText(age ? `−${age}${this.unit}` : "now", Math.max(left + 14, px(end - age)), height - 2)
    }
    this.series.forEach((name, index) => {
      c.strokeStyle = this.#colours[name]
      c.lineWidth = index ? 1.25 : 2
      c.setLineDash(index ? [5, 3] : [])
      line(c, this.#points.filter((point) => Number.isFinite(point[index + 1])).map((point) => [px(point[0]), py(point[index + 1])]))
    })
    c.setLineDash([])
  }
}

function line(c, points) {
  c.beginPath()
  points.forEach(([x, y], index) => (index ? c.lineTo(x, y) : c.moveTo(x, y)))
  c.stroke()
}

function ticks(low, high, count) {
  const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough))
  const step = [1, 2, 5, 10].map((each) => each * power).find((each) => each >= rough)
  const found = []
  for (let value = Math.ceil(low / step) * step; value <= high; value += step) found.push(Math.abs(value) < step / 1e6 ? 0 : value)
  return found
}

export function format(value) {
  if (!Number.isFinite(value)) return "–"
  const size = Math.abs(value)
  if (size && (size >= 1e5 || size < 1e-3)) return value.toExponential(1).replace("-", "−")
  return String(Number(value.toPrecision(4))).replace("-", "−")
}
