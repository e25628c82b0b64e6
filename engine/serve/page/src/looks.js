// How each Gaussian of the scene looks: as it is, hidden, lit or dimmed. It knows nothing of the renderer, except the
// names of the PLY properties.

export const AS_IT_IS = 0;
export const HIDDEN = 1;
export const LIT = 2;
export const DIMMED = 3;

const LIGHT = [1.0, 0.72, 0.1]; // colour of a lit object, amber
const LIGHT_SHARE = 0.55;
const DIM_COLOUR = 0.5; // share of the colour that is left
const DIM_OPACITY = 0.4; // share of the opacity that is left
const SH_C0 = 0.28209479177387814; // by definition
const INVISIBLE = -1e3; // logit of an opacity of 0

/**
 * Return the looks of `count` Gaussians. `objects` are {members, hidden, lit}, members with a byte for each Gaussian. With
 * `dim`, what is not lit is dimmed. A Gaussian of two objects is hidden only where both are.
 */
export function looksOf(count, objects, dim) {
  const looks = new Uint8Array(count).fill(dim ? DIMMED : AS_IT_IS);
  const shown = new Uint8Array(count);
  for (const { members, hidden } of objects) {
    for (let i = 0; i < count; i += 1) if (members[i] && !hidden) shown[i] = 1;
  }
  for (const { members, hidden, lit } of objects) {
    for (let i = 0; i < count; i += 1) {
      if (!members[i]) continue;
      if (lit && !hidden) looks[i] = LIT;
      else if (hidden && !shown[i]) looks[i] = HIDDEN;
    }
  }
  return looks;
}

/** Return a byte of 0 or 1 for each of `count` Gaussians from packed bits, the lowest bit of each byte first. */
export function unpackedBits(bytes, count) {
  return Uint8Array.from({ length: count }, (_, i) => (bytes[i >> 3] >> (i & 7)) & 1);
}

/**
 * Return `splats` (PlayCanvas' GSplatData) as they look. `order[place]` is the number in the file of the Gaussian at a
 * place in memory. The file's own values stay as they are.
 */
export function withLooks(splats, looks, order) {
  if (!looks) return splats;
  const changed = new Map();
  const change = (name, of) => {
    const values = Float32Array.from(splats.getProp(name));
    for (let place = 0; place < values.length; place += 1) values[place] = of(looks[order[place]], values[place]);
    changed.set(name, values);
  };
  LIGHT.forEach((light, axis) => {
    const coefficient = (light - 0.5) / SH_C0;
    change(`f_dc_${axis}`, (look, value) => {
      if (look === LIT) return (1 - LIGHT_SHARE) * value + LIGHT_SHARE * coefficient;
      return look === DIMMED ? (DIM_COLOUR * (value * SH_C0 + 0.5) - 0.5) / SH_C0 : value;
    });
  });
  change("opacity", (look, value) => {
    if (look === HIDDEN) return INVISIBLE;
    return look === DIMMED ? logit(DIM_OPACITY / (1 + Math.exp(-value))) : value;
  });
  return { numSplats: splats.numSplats, activated: splats.activated, getProp: (name) => changed.get(name) ?? splats.getProp(name) };
}

function logit(share) {
  return Math.log(share / (1 - share));
}
