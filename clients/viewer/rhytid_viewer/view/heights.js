// The passes of the package: stretch to weights, lines, cushions and heights of a UDIM.

import { Program, Target, Textures } from './gl.js';

/** @typedef {import('./types.js').SkinPackage} SkinPackage */

export class Heights {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {Textures} textures
   * @param {SkinPackage} skinPackage
   */
  constructor(gl, textures, skinPackage) {
    const { manifest, shaders } = skinPackage;
    this._gl = gl;
    this._textures = textures;
    this._manifest = manifest;
    this._programs = Object.fromEntries(
      Object.entries(shaders.passes).map(([name, text]) => [name, new Program(gl, name, shaders.vertex, text)]),
    );
    /** @type {Map<number, Record<string, WebGLTexture>>} */
    this._udims = new Map();
    for (const [udim, found] of skinPackage.textures) this._udims.set(udim, uploaded(textures, found));
    const { stretch, weights, resolution, cushion } = manifest;
    /** What `begin` took, until it changes. @type {Float32Array | null} */
    this._begun = null;
    this.stretch = textures.plain('RGBA32F', stretch.width, stretch.height);
    /** @param {string} format @param {number} width @param {number} height */
    const target = (format, width, height) =>
      new Target(gl, textures.plain(format, width, height), width, height);
    this._weights = target('RGBA32F', weights.width, weights.height);
    this._target = target('R32F', resolution, resolution);
    const side = cushion?.textures.size;
    this._cushion = side ? target('R32F', side, side) : null;
    const lines = cushion?.lines;
    this._lines = lines ? target('RGBA32F', lines.width, lines.height) : null;
  }

  /** The triangle of every texel. @param {number} udim */
  triangles(udim) {
    return this._of(udim).rhytid_triangles;
  }

  /** The numbers of a stretch are others now. */
  changed() {
    this._begun = null;
  }

  /**
   * Take the stretch of a frame; the one that was taken last is not sent again.
   * @param {Float32Array} stretch of stretchTexture
   */
  begin(stretch) {
    if (this._begun === stretch) return;
    this._begun = stretch;
    const { width, height } = this._manifest.stretch;
    this._textures.write(this.stretch, 'RGBA32F', 0, 0, width, height, stretch);
    this._programs.weights.use({}, { rhytid_stretch: this.stretch });
    this._weights.fill();
  }

  /**
   * Heights of a UDIM, mesh units, row 0 at the top; the texture is that of every UDIM.
   * @param {number} udim
   * @param {number[][]} [parts] column, row, columns and rows of each, where not all are wanted
   */
  draw(udim, parts) {
    /** @type {Record<string, WebGLTexture>} */
    const found = { ...this._of(udim), rhytid_weights: this._weights.texture };
    if (this._lines) {
      this._programs.lines.use({}, { ...found, rhytid_stretch: this.stretch });
      this._lines.fill();
      found.rhytid_cushion_stretch = this._lines.texture;
    }
    if (this._cushion) {
      this._programs.cushion.use({}, found);
      this._cushion.fill();
      found.rhytid_cushion = this._cushion.texture;
    }
    this._programs.height.use({}, found);
    this._target.fill(parts);
    return this._target.texture;
  }

  /**
   * Heights of a UDIM as numbers.
   * @param {number} udim
   * @param {number[]} [part] column, row, columns and rows
   */
  read(udim, part) {
    const gl = this._gl, { resolution } = this._manifest;
    const [x, y, width, height] = part ?? [0, 0, resolution, resolution];
    this.draw(udim, part && [part]);
    const out = new Float32Array(width * height);
    gl.pixelStorei(gl.PACK_ALIGNMENT, 1);
    gl.readPixels(x, y, width, height, gl.RED, gl.FLOAT, out);
    return out;
  }

  /** @param {number} udim */
  _of(udim) {
    const found = this._udims.get(udim);
    if (!found) throw new Error(`the package has no UDIM ${udim}`);
    return found;
  }
}

/** @param {Textures} textures @param {import('./types.js').UdimTextures} found */
function uploaded(textures, found) {
  /** @type {Record<string, WebGLTexture>} */
  const made = {
    rhytid_maps: textures.array(found.maps),
    rhytid_triangles: textures.array(found.triangles),
    rhytid_wrinkles: textures.array(found.wrinkles),
    rhytid_wrinkle_codes: textures.array(found.wrinkleCodes),
  };
  for (const [name, array] of Object.entries(found.cushions)) made[name] = textures.array(array);
  if (found.residual) made.rhytid_residual = textures.array(found.residual);
  return made;
}
