// Compiles the modules of the archive by the browser's own Python, so that no start has to.
// node compile.mjs PYODIDE ARCHIVE

import { readFileSync, writeFileSync } from "node:fs"
import { pathToFileURL } from "node:url"

const [pyodide, archive] = process.argv.slice(2)
const { loadPyodide } = await import(pathToFileURL(`${pyodide}/pyodide.mjs`))
const python = await loadPyodide({ indexURL: `${pyodide}/` })
python.FS.writeFile("/packages.zip", readFileSync(archive))
// the times of the files change when a browser unpacks them, so Python shall not look at them
python.runPython(`
import compileall, py_compile, shutil
shutil.unpack_archive("/packages.zip", "/packages")
compileall.compile_dir("/packages", quiet=2, invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
shutil.make_archive("/packages", "zip", "/packages")
`)
writeFileSync(archive, python.FS.readFile("/packages.zip"))
