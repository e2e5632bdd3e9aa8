// Signs in with a token that was typed, or that came behind the # of a QR code's address and never reaches a log.

const form = document.getElementById("form")
const answer = document.getElementById("answer")

async function signIn(token) {
  answer.textContent = ""
  try {
    const response = await fetch("sign-in", { method: "POST", body: new URLSearchParams({ token }) })
    if (response.ok) location.replace("./")
    else answer.textContent = await response.text()
  } catch {
    answer.textContent = "the robot does not answer"
  }
}

form.addEventListener("submit", (event) => {
  event.preventDefault()
  signIn(document.getElementById("token").value)
})

const given = new URLSearchParams(location.hash.slice(1)).get("token")
if (given) {
  history.replaceState(null, "", location.pathname)
  signIn(given)
}
