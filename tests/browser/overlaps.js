// Pairs of controls and texts whose boxes, as far as they are in sight, share a pixel; and what leaves the page.
() => {
  const shown = [...document.querySelectorAll(
    "button, select, input, .pill, dd, dt, figcaption, label, output, #where, #hint, #stick",
  )].filter((each) => each.offsetParent && each.getBoundingClientRect().width > 0)
  const name = (each) => each.id || each.textContent.trim().slice(0, 20) || each.tagName
  const boxes = shown.map((each) => {
    let { left, right, top, bottom } = each.getBoundingClientRect()
    for (let parent = each.parentElement; parent; parent = parent.parentElement) {
      if (getComputedStyle(parent).overflow === "visible") continue
      const clip = parent.getBoundingClientRect()
      left = Math.max(left, clip.left)
      right = Math.min(right, clip.right)
      top = Math.max(top, clip.top)
      bottom = Math.min(bottom, clip.bottom)
    }
    return { each, left, right, top, bottom, header: Boolean(each.closest("header")) }
  }).filter((box) => box.right > box.left && box.bottom > box.top)
  const found = []
  boxes.forEach((a, index) => {
    if (a.left < -0.5 || a.right > innerWidth + 0.5) found.push(`${name(a.each)} leaves the page`)
    for (const b of boxes.slice(index + 1)) {
      if (a.header !== b.header || a.each.contains(b.each) || b.each.contains(a.each)) continue
      const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left)
      const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top)
      if (wide > 0.5 && high > 0.5) found.push(`${name(a.each)} over ${name(b.each)}`)
    }
  })
  return found
}
