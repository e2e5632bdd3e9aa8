// Texts that do not fit their boxes.
() => [...document.querySelectorAll("button, select, .pill, dd, dt, figcaption, label, output, #where, #hint, td, th, h2")]
  .filter((each) => each.offsetParent && getComputedStyle(each).display !== "inline" && each.scrollWidth > each.clientWidth + 1)
  .map((each) => `${each.id || each.textContent.trim().slice(0, 30)}: ${each.scrollWidth} > ${each.clientWidth}`)
