// How many pixels of a canvas have the colour of the robot's curve.
(id) => {
  const canvas = document.getElementById(id), probe = document.createElement("canvas").getContext("2d")
  probe.fillStyle = getComputedStyle(canvas).getPropertyValue("--robot").trim()
  probe.fillRect(0, 0, 1, 1)
  const [r, g, b] = probe.getImageData(0, 0, 1, 1).data
  const all = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data
  let found = 0
  for (let k = 0; k < all.length; k += 4) if (all[k] === r && all[k + 1] === g && all[k + 2] === b) found++
  return found
}
