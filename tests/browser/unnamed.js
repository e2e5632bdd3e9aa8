// Parts that a screen reader would have no name for.
() => [...document.querySelectorAll("button, select, input, canvas, img, [role]")]
  .filter((each) => each.offsetParent && ![
    each.ariaLabel, each.alt, each.title, each.textContent.trim(), each.labels?.length, each.getAttribute("aria-labelledby"),
  ].some(Boolean))
  .map((each) => each.id || each.outerHTML.slice(0, 60))
