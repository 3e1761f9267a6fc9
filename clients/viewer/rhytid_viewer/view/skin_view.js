// A face with its skin on a canvas.

import { Axes } from './axes.js';
import { Camera } from './camera.js';
import { ExactTiles } from './exact_tiles.js';
import { Textures, Unsupported, createContext } from './gl.js';
import { Heights } from './heights.js';
import { MeshTextures, origin, udimAt } from './mesh_textures.js';
import { pick } from './pick.js';
import { Pose } from './pose.js';
import { Slopes } from './relief.js';
import { ReliefMaps } from './relief_maps.js';
import { Shadow } from './shadow.js';
import { STRETCH_COLOURS, STRETCH_RANGE, Surface } from './surface.js';
import { finestTilesInView, tilesInView } from './tiles_in_view.js';
import { add, dot, normalized, scaled } from './vectors.js';

/** @typedef {import('./types.js').ViewOptions} ViewOptions */
/** @typedef {import('./types.js').TileAddress} TileAddress */
/** @typedef {import('./types.js').Vector} Vector */

export { Unsupported };

const BACKGROUND = 0.052; // linear
const TILE = 512;
/** @type {ViewOptions} */
const DEFAULTS = {
  method: 'fast',
  strength: 1,
  colours: 'skin',
  axes: false,
  split: null,
  light: [-0.82, 0.3, 0.5],
};

export class SkinView {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import('./types.js').SkinPackage} skinPackage
   * @throws {Unsupported} where WebGL2 or float targets are missing
   */
  constructor(canvas, skinPackage) {
    const { manifest, mesh } = skinPackage;
    this.canvas = canvas;
    this.skinPackage = skinPackage;
    this._manifest = manifest;
    this._gl = createContext(canvas);
    try {
      this._textures = new Textures(this._gl);
      this._pose = new Pose(skinPackage);
      this._radius = radiusOf(mesh.positions);
      this._heights = new Heights(this._gl, this._textures, skinPackage);
      this._slopes = new Slopes(this._gl, this._textures, manifest);
      this._mesh = new MeshTextures(this._gl, this._textures, skinPackage);
      this._surface = new Surface(this._gl, this._mesh);
      this._axes = new Axes(this._gl, this._textures, this._mesh, mesh, this._radius);
      this._shadow = new Shadow(this._gl, this._textures, this._mesh, 1.1 * this._radius);
      this._exact = new ExactTiles(this._textures, this._slopes, manifest.resolution);
      this._nothing = this._textures.plain('R8_UINT', 1, 1);
    } catch (error) {
      this.dispose();
      throw error;
    }
    this._options = { ...DEFAULTS };
    this._neutralStretch = Float32Array.from(this._pose.stretch);
    const relief = () => new ReliefMaps(this._heights, this._slopes, manifest.resolution);
    this._relief = { neutral: relief(), posed: relief() };
    this._stale = { mesh: true, shadow: true };
    this._frameMilliseconds = 0;
    /** Looks at the whole mesh at first. */
    this.camera = this._newCamera();
  }

  /** Colours of the stretch, from the least to the most. @returns {import('./types.js').LegendEntry[]} */
  static legend() {
    return STRETCH_COLOURS.map((colour, i) => ({
      ratio: Math.exp((i / 2 - 1) * STRETCH_RANGE),
      colour: `rgb(${colour.map(encoded).join(' ')})`,
    }));
  }

  /**
   * Pose the mesh. A new pose forgets all tiles.
   * @param {ArrayLike<number>} weights one of every shape
   */
  setWeights(weights) {
    this._pose.set(weights);
    this._exact.clear();
    this._heights.changed();
    this._relief.posed.forget();
    this._stale.mesh = this._stale.shadow = true;
  }

  /**
   * Change how it looks. To leave the method `exact` forgets all tiles and gives their memory back.
   * @param {Partial<ViewOptions>} options those that change
   */
  setOptions(options) {
    const leaves = options.method !== undefined && options.method !== 'exact';
    if (leaves && this._options.method === 'exact') this._exact.free();
    this._options = { ...this._options, ...options };
    if (options.light) this._stale.shadow = true;
  }

  /**
   * A tile of the service for the pose that is set.
   * @param {TileAddress} address
   * @param {number} size texels a side
   * @param {Float32Array | null} heights mesh units, row by row; null forgets the tile
   * @throws {Error} where there is no such tile
   */
  setExactTile(address, size, heights) {
    this._exact.set(address, size, heights);
  }

  /**
   * What has to be asked for to fill the picture, at the level whose texels are about a pixel, the
   * middle of the picture first.
   * @returns {{level: number, tiles: TileAddress[]}}
   */
  tilesInView() {
    const { resolution, settings } = this._manifest;
    const { posed, matrix, width, height } = this._seen();
    const grid = { resolution, tile: Math.min(settings.tile_size ?? TILE, resolution) };
    return tilesInView(posed, grid, matrix, width, height);
  }

  /** Of the posed mesh, x, y, z in the original order of vertices, with the centre: what a service
   * takes as a frame. @returns {Float32Array} */
  positions() {
    return this._pose.original();
  }

  /** Displacement of every texel of a UDIM by the fast method, mesh units, row 0 at the top.
   * @param {number} udim @returns {Float32Array} */
  heights(udim) {
    this._heights.begin(this._pose.stretch);
    return this._heights.read(udim);
  }

  /** Moments of the slopes of a UDIM by the fast method, five of every texel of a level, row 0 at the
   * top: mean slopes by column and row, and the means of their products xx, xy, yy; mesh units over the
   * side of the map. @param {number} udim @param {number} level @returns {Float32Array} */
  moments(udim, level) {
    return this._relief.posed.moments(udim, level, this._pose.stretch);
  }

  /** Log stretch and axes of the pose, in the layout of the package's stretch.js.
   * @returns {Float32Array} */
  stretch() {
    return this._pose.stretch;
  }

  /** Draw a frame. The size of the canvas in pixels is the caller's. */
  draw() {
    const start = performance.now();
    this._update();
    const gl = this._gl, { width, height } = this.canvas;
    const level = this._options.method === 'exact' ? this.tilesInView().level : 0;
    const uniforms = this._uniforms();
    // Before the canvas is drawn on: slopes of new tiles are drawn here.
    const drawn = this._manifest.udims.map((udim) => {
      const own = { ...uniforms };
      return { udim, textures: this._texturesOf(udim, level, own), own };
    });
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    const grey = encoded(BACKGROUND) / 255;
    gl.clearColor(0.95 * grey, 0.98 * grey, 1.06 * grey, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    for (const { udim, textures, own } of drawn) this._surface.draw(udim, own, textures);
    if (this._options.axes) this._axes.draw(uniforms, { u_stretch: this._heights.stretch });
    this._frameMilliseconds = performance.now() - start;
  }

  /**
   * What lies at a place of the picture.
   * @param {number} x CSS pixels from the left of the canvas
   * @param {number} y CSS pixels from its top
   * @returns {import('./types.js').Probe | null} null beside the mesh
   */
  probe(x, y) {
    const { origin: from, direction } = this.camera.ray(x, y), { indices, uvs } = this.skinPackage.mesh;
    const hit = pick(this._pose.positions, indices, from, direction);
    if (!hit) return null;
    const { triangle, weights } = hit, { resolution, mesh } = this._manifest;
    const [u, v] = [0, 1].map((axis) =>
      weights.reduce((sum, weight, corner) => sum + weight * uvs[2 * indices[3 * triangle + corner] + axis], 0),
    );
    const those = this._mesh.udims[triangle], udim = those.find((one) => one === udimAt(u, v)) ?? those[0];
    const [column, row] = origin(udim);
    const [s, t] = [u - column, v + row].map((at) => Math.max(0, Math.min(resolution - 1, Math.floor(at * resolution))));
    const stretch = this._pose.stretch.subarray(8 * triangle);
    const where = add(add(from, scaled(direction, hit.distance)), /** @type {Vector} */ (mesh.centre));
    return {
      triangle,
      udim,
      texel: [s, t],
      displacement: this._displacement(udim, s, t),
      ratios: [Math.exp(stretch[4]), Math.exp(stretch[5])],
      position: where,
    };
  }

  /** The picture as PNG. @returns {Promise<Blob>} */
  picture() {
    this.draw();
    return new Promise((resolve, reject) =>
      this.canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error('the browser made no picture')))),
    );
  }

  /** @returns {import('./types.js').Statistics} */
  statistics() {
    return {
      textureBytes: this._textures.bytes,
      stretchMilliseconds: this._pose.stretchMilliseconds,
      frameMilliseconds: this._frameMilliseconds,
    };
  }

  /** Free everything on the GPU. */
  dispose() {
    this._gl.getExtension('WEBGL_lose_context')?.loseContext();
  }

  _newCamera() {
    const { canvas } = this;
    const size = () => ({ width: canvas.clientWidth || canvas.width, height: canvas.clientHeight || canvas.height });
    const camera = new Camera(size, (from, direction) => {
      const hit = pick(this._pose.positions, this.skinPackage.mesh.indices, from, direction);
      return hit && add(from, scaled(direction, hit.distance));
    });
    camera.radius = this._radius;
    const { middle, half } = boxOf(this.skinPackage.mesh.positions);
    camera.target = middle;
    camera.distance = (1.1 * Math.max(half[0], half[1])) / Math.tan(camera.fov / 2) + half[2];
    camera.range = [this._radius / 300, 4 * camera.distance];
    return camera;
  }

  /** What the options ask for and is not drawn yet. */
  _update() {
    const { method, split, light } = this._options, stale = this._stale;
    if (stale.mesh) this._mesh.write(this._pose);
    if (method === 'neutral' || split !== null) this._draw('neutral', this._neutralStretch);
    if (method !== 'neutral') this._draw('posed', this._pose.stretch);
    this._heights.begin(this._pose.stretch); // colours and axes read it
    stale.mesh = false;
    if (stale.shadow) this._shadow.draw(normalized(light));
    stale.shadow = false;
  }

  /** @param {'neutral' | 'posed'} name @param {Float32Array} stretch */
  _draw(name, stretch) {
    const maps = this._relief[name];
    if (!maps.stale(this._manifest.udims)) return;
    const { posed, matrix, width, height } = this._seen();
    const cells = finestTilesInView(posed, { resolution: this._manifest.resolution, tile: maps.cell }, matrix, width, height);
    maps.draw(cells, stretch);
  }

  /** What is in the picture is found by these. */
  _seen() {
    const { width, height } = this.canvas, { indices, uvs } = this.skinPackage.mesh;
    const posed = { positions: this._pose.positions, indices, uvs, udims: this._mesh.udims };
    return { posed, matrix: this.camera.matrix(width / height), width, height };
  }

  _uniforms() {
    const { width, height } = this.canvas, { split, method, strength, light, colours } = this._options;
    return {
      u_matrix: this.camera.matrix(width / height),
      u_shadow_matrix: this._shadow.matrix,
      u_shadow_offset: 3 * this._shadow.texel,
      u_shadow_spread: 2 * this._shadow.step,
      u_triangles_a_row: this._manifest.stretch.triangles_a_row,
      u_split: split === null || method === 'neutral' ? 0 : split * width,
      u_unit: strength * this._manifest.scale,
      u_cavity: (0.18 * strength * this._manifest.scale) / this._manifest.blend.depth,
      u_light: normalized(light),
      u_fill: fillOf(normalized(light), this.camera.axes()),
      u_eye: this.camera.eye(),
      u_colours: Number(colours === 'stretch'),
      u_picture: [width, height],
      u_focal: height / (2 * Math.tan(this.camera.fov / 2)),
      u_density: width / (this.canvas.clientWidth || width),
      u_with_tiles: 0,
    };
  }

  /** @param {number} udim @param {number} level of tiles @param {Record<string, number | ArrayLike<number>>} uniforms */
  _texturesOf(udim, level, uniforms) {
    const { method } = this._options;
    const shown = this._relief[method === 'neutral' ? 'neutral' : 'posed'].textures(udim);
    if (!shown) throw new Error(`nothing is drawn of UDIM ${udim}`);
    const tiles = method === 'exact' ? this._exact.of(udim, level) : null;
    uniforms.u_with_tiles = Number(tiles !== null);
    const neutral = this._relief.neutral.textures(udim) ?? shown;
    return {
      u_relief: shown.relief,
      u_moments: shown.moments,
      u_neutral_relief: neutral.relief,
      u_neutral_moments: neutral.moments,
      u_tiles: tiles?.tiles ?? shown.relief,
      u_present: tiles?.present ?? this._nothing,
      u_shadow: this._shadow.texture,
      u_stretch: this._heights.stretch,
    };
  }

  /** @param {number} udim @param {number} column @param {number} row */
  _displacement(udim, column, row) {
    const neutral = this._options.method === 'neutral';
    this._heights.begin(neutral ? this._neutralStretch : this._pose.stretch);
    return this._heights.read(udim, [column, row, 1, 1])[0];
  }
}

/**
 * Towards the weak light: from the other side of the eye than the light, and from above.
 * @param {Vector} light of length 1
 * @param {{right: Vector, up: Vector, back: Vector}} axes of the camera
 */
function fillOf(light, { right, up, back }) {
  const side = dot(light, right) > 0 ? -1 : 1;
  return normalized(add(add(scaled(right, side), scaled(up, 0.35)), scaled(back, 0.55)));
}

/** Of the ball around the middle that holds all vertices. @param {Float32Array} positions */
function radiusOf(positions) {
  let most = 0;
  for (let i = 0; i < positions.length; i += 3)
    most = Math.max(most, Math.hypot(positions[i], positions[i + 1], positions[i + 2]));
  return most;
}

/** The middle of the box around all vertices, and half of its sides. @param {Float32Array} positions */
function boxOf(positions) {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  positions.forEach((at, i) => {
    low[i % 3] = Math.min(low[i % 3], at);
    high[i % 3] = Math.max(high[i % 3], at);
  });
  /** @param {number} sign */
  const mean = (sign) => /** @type {Vector} */ (high.map((at, i) => (at + sign * low[i]) / 2));
  return { middle: mean(1), half: mean(-1) };
}

/** sRGB from 0 to 255. @param {number} x linear */
function encoded(x) {
  return Math.round(255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055));
}
