// Bundles src/ to dist/, and the page that exported scenes bring with them to engine/delivery/packages/viewer_files. `node build.mjs` needs only what `npm ci` installed.
import { build } from "esbuild";
import { copyFile, mkdir, readFile, readdir, rm, writeFile } from "node:fs/promises";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";

const SHOWN = "../../delivery/packages/viewer_files";

const here = path.dirname(fileURLToPath(import.meta.url));
process.chdir(here);
for (const folder of ["dist", SHOWN]) {
  await rm(folder, { recursive: true, force: true });
  await mkdir(folder, { recursive: true });
}

const common = {
  bundle: true,
  minify: true,
  format: "esm",
  target: ["es2022"],
  legalComments: "none", // The full texts are in licences.txt.
  metafile: true,
  logLevel: "warning",
};
const results = [
  // The viewer stays a file of its own, which the page loads only when there is a scene to show.
  await build({ ...common, entryPoints: ["src/main.js"], outfile: "dist/app.js", external: ["./viewer.js"] }),
  await build({ ...common, entryPoints: ["src/viewer.js"], outfile: "dist/viewer.js" }),
  await build({ ...common, entryPoints: ["src/style.css"], outfile: "dist/style.css" }),
  await build({ ...common, entryPoints: ["src/show.js"], outfile: `${SHOWN}/show.js` }),
  await build({ ...common, entryPoints: ["src/show.css"], outfile: `${SHOWN}/show.css` }),
];
await copyFile("src/index.html", "dist/index.html");
await writeFile("dist/licences.txt", await licences(results));
// The same bundle as the server's.
await writeFile(`${SHOWN}/viewer.js.gz`, gzipSync(await readFile("dist/viewer.js"), { level: 9 }));
await writeFile(`${SHOWN}/licences.txt`, await licences([results[1], results[3]]));

for (const name of (await readdir("dist")).sort()) {
  const size = gzipSync(await readFile(path.join("dist", name)), { level: 9 }).length;
  console.log(`dist/${name}: ${(size / 1024).toFixed(0)} KiB with gzip`);
}

/** Return name, version and licence text of each package of which code is in the bundles. */
async function licences(builds) {
  const folders = new Set();
  for (const { metafile } of builds) {
    for (const output of Object.values(metafile.outputs)) {
      for (const [file, { bytesInOutput }] of Object.entries(output.inputs)) {
        const match = /^(.*node_modules\/(?:@[^/]+\/)?[^/]+)\//.exec(file);
        if (match && bytesInOutput > 0) folders.add(match[1]);
      }
    }
  }
  const parts = [];
  for (const folder of [...folders].sort()) {
    const { name, version, license } = JSON.parse(await readFile(path.join(folder, "package.json"), "utf8"));
    const file = (await readdir(folder)).find((entry) => /^licen[cs]e/i.test(entry));
    const text = file ? await readFile(path.join(folder, file), "utf8") : licenceInReadme(await readme(folder));
    if (!text) throw new Error(`${name} has no licence text.`);
    parts.push(`${name} ${version} (${license})\n\n${text.trim()}\n`);
  }
  return parts.join(`\n${"-".repeat(78)}\n\n`);
}

async function readme(folder) {
  const file = (await readdir(folder)).find((entry) => /^readme/i.test(entry));
  return file ? readFile(path.join(folder, file), "utf8") : "";
}

/** Some small packages have their licence in the readme only. */
function licenceInReadme(text) {
  const start = text.search(/^#+ *licen[cs]e/im);
  return start < 0 ? "" : text.slice(start);
}
