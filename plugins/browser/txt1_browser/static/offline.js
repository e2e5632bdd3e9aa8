// Keeps all files, so that the page opens without a network once it has been loaded.

const list = async () => (await fetch("files.json", { cache: "no-store" })).json()

self.addEventListener("install", (event) => {
  event.waitUntil(list().then(async ({ version, files }) => {
    const kept = await caches.open(version)
    await kept.addAll(["./", ...files])
    for (const name of await caches.keys()) if (name !== version) await caches.delete(name)
    await self.skipWaiting()
  }))
})

self.addEventListener("activate", (event) => event.waitUntil(self.clients.claim()))

self.addEventListener("fetch", (event) => {
  if (event.request.method !== "GET" || new URL(event.request.url).origin !== location.origin) return
  event.respondWith(caches.match(event.request, { ignoreSearch: true }).then((found) => found ?? fetch(event.request)))
})
