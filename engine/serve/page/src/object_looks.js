// Which objects of the scene are hidden, which one is lit, and whether the rest is dimmed.
import { looksOf, unpackedBits } from "./looks.js";

/**
 * Return {isHidden(id), lit(), isDim(), setHidden(id, value), light(id), setDim(value), reset(), forget(id), members(id)}.
 * `read(id)` returns a promise of {count, bits}: the number of Gaussians of the scene and a bit for each, packed.
 * `changed()` is called after each change, before the picture shows it.
 */
export function createObjectLooks(viewer, read, changed = () => {}) {
  const hidden = new Set();
  const known = new Map(); // id -> promise of the members, a byte for each Gaussian
  let lit = null;
  let dim = false;
  let turn = 0;

  function members(id) {
    if (!known.has(id)) {
      const reading = Promise.resolve(read(id)).then(({ count, bits }) => unpackedBits(bits, count));
      reading.catch(() => known.delete(id)); // It is tried again.
      known.set(id, reading);
    }
    return known.get(id);
  }

  async function apply() {
    const mine = ++turn;
    changed();
    if (!viewer()) return;
    const ids = [...new Set([...hidden, ...(lit === null ? [] : [lit])])];
    const found = await Promise.all(ids.map(members));
    if (mine !== turn || !viewer()) return;
    if (ids.length === 0) return viewer().setLooks(null);
    const objects = ids.map((id, index) => ({ members: found[index], hidden: hidden.has(id), lit: id === lit }));
    await viewer().setLooks(looksOf(found[0].length, objects, dim && lit !== null && !hidden.has(lit)));
  }

  return {
    isHidden: (id) => hidden.has(id),
    lit: () => lit,
    isDim: () => dim,
    members,
    setHidden: (id, value) => {
      if (value) hidden.add(id);
      else hidden.delete(id);
      return apply();
    },
    light: (id) => {
      lit = id;
      if (id !== null) hidden.delete(id);
      return apply();
    },
    setDim: (value) => {
      dim = value;
      return apply();
    },
    /** Another scene is loaded, whose Gaussians are other ones: all look as they are. */
    reset: () => {
      known.clear();
      hidden.clear();
      lit = null;
      turn += 1;
      changed();
    },
    /** An object was changed or deleted: what is known of it is wrong. */
    forget: (id, isGone) => {
      known.delete(id);
      if (isGone) hidden.delete(id);
      if (isGone && lit === id) lit = null;
      return isGone || hidden.has(id) || lit === id ? apply() : Promise.resolve();
    },
  };
}
