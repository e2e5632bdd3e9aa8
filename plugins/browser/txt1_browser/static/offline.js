// Keeps all files, so that the page opens without a network once it has been loaded. txt1_browser/site.py writes `site`
// at its head, so that a new version of any file is a new version of this one, which browsers look for.

async function keep() {
  const kept = await caches.open(site.version)
  await kept.addAll(["./", ...site.files])
  for (const name of await caches.keys()) if (name !== site.version) await caches.delete(name)
  await self.skipWaiting()
}

self.addEventListener("install", (event) => event.waitUntil(keep().catch(async (error) => {
  const why = `it will not open without a network, as the browser keeps no more files (${error.message}); make room there`
  for (const each of await clients.matchAll({ includeUncontrolled: true })) each.postMessage(why)
  throw error
})))

self.addEventListener("activate", (event) => event.waitUntil(self.clients.claim()))

self.addEventListener("fetch", (event) => {
  if (event.request.method !== "GET" || new URL(event.request.url).origin !== location.origin) return
  event.respondWith(caches.match(event.request, { ignoreSearch: true }).then((found) => found ?? fetch(event.request)))
})
