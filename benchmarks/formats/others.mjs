// Writes what viewers' own programs make of a PLY: KSPLAT by GaussianSplats3D, at its three levels, and SPLAT by gsplat.
//
//   node others.mjs scene.ply folder
//
// The fixtures level_0.ksplat to level_2.ksplat and gsplat.splat of tests/fixtures/formats are made of niantic_3.ply;
// playcanvas.sog of playcanvas.ply by `splat-transform -g cpu`, and playcanvas.sog.ply of that by `splat-transform`.
import fs from "node:fs";
import path from "node:path";

// Both libraries look for a page when they are imported; what is used of them needs none.
globalThis.window ??= globalThis;
globalThis.self ??= globalThis;
globalThis.document ??= { createElement: () => ({ getContext: () => null, style: {} }), addEventListener() {} };

const [, , source, folder] = process.argv;
const bytes = fs.readFileSync(source);
const content = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);

const { PlyParser, SplatBufferGenerator } = await import("@mkkellogg/gaussian-splats-3d");
const splats = PlyParser.parseToUncompressedSplatArray(content, 2);
for (const level of [0, 1, 2]) {
  const packed = SplatBufferGenerator.getStandardGenerator(0, level).generateFromUncompressedSplatArray(splats);
  fs.writeFileSync(path.join(folder, `level_${level}.ksplat`), Buffer.from(packed.bufferData));
}

const { PLYLoader, Scene } = await import("gsplat");
const splat = PLYLoader.LoadFromArrayBuffer(content, new Scene());
fs.writeFileSync(path.join(folder, "gsplat.splat"), Buffer.from(splat.data.serialize()));
