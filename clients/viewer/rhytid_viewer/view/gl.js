// Programs, textures and targets of WebGL2.

/** The browser or its graphics lack what is needed; the message says what. */
export class Unsupported extends Error {}

/**
 * @param {HTMLCanvasElement} canvas
 * @returns {WebGL2RenderingContext}
 * @throws {Unsupported}
 */
export function createContext(canvas) {
  const gl = canvas.getContext('webgl2', { antialias: true, alpha: false });
  if (!gl) throw new Unsupported('This browser gives no WebGL2, which the viewer draws with.');
  if (!gl.getExtension('EXT_color_buffer_float'))
    throw new Unsupported('The graphics here cannot draw into float textures (EXT_color_buffer_float).');
  return gl;
}

/** A compiled program whose uniforms are set by name. */
export class Program {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {string} name for messages
   * @param {string} vertex
   * @param {string} fragment
   */
  constructor(gl, name, vertex, fragment) {
    this._gl = gl;
    this._program = linked(gl, name, vertex, fragment);
    /** @type {Map<string, {at: WebGLUniformLocation | null, type: number}>} */
    this._uniforms = new Map();
    /** @type {Map<string, number>} the unit of every sampler */
    this._units = new Map();
    gl.useProgram(this._program);
    const count = gl.getProgramParameter(this._program, gl.ACTIVE_UNIFORMS);
    for (let i = 0; i < count; i++) this._found(i);
  }

  /** @param {number} i of an active uniform */
  _found(i) {
    const gl = this._gl;
    const info = gl.getActiveUniform(this._program, i);
    if (!info) return;
    const at = gl.getUniformLocation(this._program, info.name);
    this._uniforms.set(info.name, { at, type: info.type });
    if (!(info.type in TARGETS)) return;
    gl.uniform1i(at, this._units.size);
    this._units.set(info.name, this._units.size);
  }

  /** @param {string} name of an attribute */
  attribute(name) {
    return this._gl.getAttribLocation(this._program, name);
  }

  /**
   * Make it the current one.
   * @param {Record<string, number | ArrayLike<number>>} values of uniforms; those that it does not have are left out
   * @param {Record<string, WebGLTexture>} [textures] of samplers
   */
  use(values, textures = {}) {
    const gl = this._gl;
    gl.useProgram(this._program);
    for (const [name, texture] of Object.entries(textures)) {
      const unit = this._units.get(name), uniform = this._uniforms.get(name);
      if (unit === undefined || !uniform) continue;
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(TARGETS[uniform.type], texture);
    }
    for (const [name, value] of Object.entries(values)) this._set(name, value);
  }

  /** @param {string} name @param {number | ArrayLike<number>} value */
  _set(name, value) {
    const gl = this._gl, uniform = this._uniforms.get(name);
    if (!uniform) return;
    const { at, type } = uniform;
    const list = typeof value === 'number' ? [value] : Array.from(value);
    if (type === gl.FLOAT) gl.uniform1fv(at, list);
    else if (type === gl.FLOAT_VEC2) gl.uniform2fv(at, list);
    else if (type === gl.FLOAT_VEC3) gl.uniform3fv(at, list);
    else if (type === gl.FLOAT_MAT4) gl.uniformMatrix4fv(at, false, list);
    else gl.uniform1iv(at, list);
  }
}

const TEXTURE_2D = 0x0de1, TEXTURE_2D_ARRAY = 0x8c1a;
/** What textures of a sampler are bound to. Numbers, since there may be no WebGL2 to ask.
 * @type {Record<number, number>} */
const TARGETS = {
  0x8b5e: TEXTURE_2D, // SAMPLER_2D
  0x8b62: TEXTURE_2D, // SAMPLER_2D_SHADOW
  0x8dd2: TEXTURE_2D, // UNSIGNED_INT_SAMPLER_2D
  0x8dc1: TEXTURE_2D_ARRAY, // SAMPLER_2D_ARRAY
  0x8dd7: TEXTURE_2D_ARRAY, // UNSIGNED_INT_SAMPLER_2D_ARRAY
};

/** @param {WebGL2RenderingContext} gl @param {string} name @param {string} vertex @param {string} fragment */
function linked(gl, name, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(Number(kind));
    if (!shader) throw new Unsupported('The graphics of this page are lost.');
    gl.shaderSource(shader, String(source));
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS))
      throw new Error(`shader ${name}: ${gl.getShaderInfoLog(shader)}`);
    gl.deleteShader(shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS))
    throw new Error(`shader ${name}: ${gl.getProgramInfoLog(program)}`);
  return program;
}

/** @typedef {{internal: number, format: number, type: number, bytes: number}} Format */

/** Makes textures and counts their bytes. */
export class Textures {
  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this._gl = gl;
    /** @type {Map<WebGLTexture, number>} */
    this._bytes = new Map();
    this._most = { side: gl.getParameter(gl.MAX_TEXTURE_SIZE), layers: gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS) };
    this.anisotropy = gl.getExtension('EXT_texture_filter_anisotropic');
    /** @type {Record<string, Format>} */
    this.formats = {
      R8_SNORM: { internal: gl.R8_SNORM, format: gl.RED, type: gl.BYTE, bytes: 1 },
      R8_UINT: { internal: gl.R8UI, format: gl.RED_INTEGER, type: gl.UNSIGNED_BYTE, bytes: 1 },
      R16_UINT: { internal: gl.R16UI, format: gl.RED_INTEGER, type: gl.UNSIGNED_SHORT, bytes: 2 },
      R32_UINT: { internal: gl.R32UI, format: gl.RED_INTEGER, type: gl.UNSIGNED_INT, bytes: 4 },
      RGBA32_UINT: { internal: gl.RGBA32UI, format: gl.RGBA_INTEGER, type: gl.UNSIGNED_INT, bytes: 16 },
      R32F: { internal: gl.R32F, format: gl.RED, type: gl.FLOAT, bytes: 4 },
      RGBA16F: { internal: gl.RGBA16F, format: gl.RGBA, type: gl.HALF_FLOAT, bytes: 8 },
      RGBA32F: { internal: gl.RGBA32F, format: gl.RGBA, type: gl.FLOAT, bytes: 16 },
      DEPTH: { internal: gl.DEPTH_COMPONENT16, format: gl.DEPTH_COMPONENT, type: gl.UNSIGNED_SHORT, bytes: 2 },
    };
  }

  /** Bytes of all that are there. */
  get bytes() {
    return [...this._bytes.values()].reduce((sum, bytes) => sum + bytes, 0);
  }

  /**
   * An empty texture without filter.
   * @param {string} format @param {number} width @param {number} height @param {number} [levels]
   * @throws {Unsupported} where the graphics take none of this size; Error where they have no memory
   */
  plain(format, width, height, levels = 1) {
    const gl = this._gl, { internal, bytes } = this.formats[format];
    this._checkSize(width, height, 1);
    const texture = this._bound(gl.TEXTURE_2D);
    gl.texStorage2D(gl.TEXTURE_2D, levels, internal, width, height);
    this._checkMemory(texture, `${width} x ${height} texels of ${format}`);
    let sum = 0;
    for (let level = 0; level < levels; level++)
      sum += Math.max(width >> level, 1) * Math.max(height >> level, 1) * bytes;
    this._bytes.set(texture, sum);
    return texture;
  }

  /**
   * An empty square texture with all its levels, filtered over and between them.
   * @param {string} format @param {number} side a power of two
   */
  filtered(format, side) {
    const gl = this._gl;
    const texture = this.plain(format, side, side, Math.log2(side) + 1);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    if (this.anisotropy)
      gl.texParameterf(gl.TEXTURE_2D, this.anisotropy.TEXTURE_MAX_ANISOTROPY_EXT, 8);
    return texture;
  }

  /** @param {import('./types.js').TextureArray} array @throws {Unsupported} as `plain` does */
  array(array) {
    const gl = this._gl, { width, height, layers, texels } = array;
    const { internal, format, type, bytes } = this.formats[array.format];
    this._checkSize(width, height, layers);
    const texture = this._bound(gl.TEXTURE_2D_ARRAY);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, internal, width, height, layers);
    this._checkMemory(texture, `${width} x ${height} x ${layers} texels of ${array.format}`);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    const size = width * height;
    for (let layer = 0; layer < layers; layer++) {
      const part = texels.subarray(layer * size, (layer + 1) * size);
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, layer, width, height, 1, format, type, part);
    }
    this._bytes.set(texture, size * layers * bytes);
    return texture;
  }

  /**
   * Write a part of a texture of `plain` or `filtered`, level 0.
   * @param {WebGLTexture} texture @param {string} format
   * @param {number} x @param {number} y @param {number} width @param {number} height
   * @param {ArrayBufferView} texels
   */
  write(texture, format, x, y, width, height, texels) {
    const gl = this._gl, { format: channels, type } = this.formats[format];
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, x, y, width, height, channels, type, texels);
  }

  /** @param {WebGLTexture} texture */
  remove(texture) {
    this._gl.deleteTexture(texture);
    this._bytes.delete(texture);
  }

  /** @param {number} width @param {number} height @param {number} layers */
  _checkSize(width, height, layers) {
    if (this._gl.isContextLost()) throw new Unsupported('The graphics of this page are lost.');
    const { side, layers: most } = this._most;
    if (Math.max(width, height) > side)
      throw new Unsupported(`The graphics here take textures of ${side} texels a side at most; this skin has one of ${width} x ${height}.`);
    if (layers > most)
      throw new Unsupported(`The graphics here take ${most} layers of a texture at most; this skin has one of ${layers}.`);
  }

  /** @param {WebGLTexture} texture @param {string} what it is */
  _checkMemory(texture, what) {
    const gl = this._gl, error = gl.getError();
    if (error === gl.NO_ERROR) return;
    gl.deleteTexture(texture);
    if (error === gl.CONTEXT_LOST_WEBGL) throw new Unsupported('The graphics of this page are lost.');
    if (error === gl.OUT_OF_MEMORY)
      throw new Error(`The graphics have no memory for ${what}, beside the ${Math.round(this.bytes / 1e6)} MB that the page has.`);
    throw new Error(`The graphics refuse ${what} (error ${error} of WebGL).`);
  }

  /** @param {number} target */
  _bound(target) {
    const gl = this._gl;
    const texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(target, texture);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(target, name, gl.NEAREST);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T])
      gl.texParameteri(target, name, gl.CLAMP_TO_EDGE);
    return texture;
  }
}

/** A framebuffer over one texture, or more that are filled at once. */
export class Target {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {WebGLTexture} texture
   * @param {number} width
   * @param {number} height
   * @param {{depth?: boolean, beside?: WebGLTexture[]}} [what] whether it is of depths; what else is filled
   */
  constructor(gl, texture, width, height, { depth = false, beside = [] } = {}) {
    this._gl = gl;
    this.texture = texture;
    this.beside = beside;
    this.width = width;
    this.height = height;
    this._framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this._framebuffer);
    const point = depth ? gl.DEPTH_ATTACHMENT : gl.COLOR_ATTACHMENT0;
    gl.framebufferTexture2D(gl.FRAMEBUFFER, point, gl.TEXTURE_2D, texture, 0);
    beside.forEach((one, i) => gl.framebufferTexture2D(gl.FRAMEBUFFER, point + i + 1, gl.TEXTURE_2D, one, 0));
    if (beside.length > 0) gl.drawBuffers([texture, ...beside].map((_, i) => point + i));
    if (gl.checkFramebufferStatus(gl.FRAMEBUFFER) !== gl.FRAMEBUFFER_COMPLETE)
      throw new Unsupported('The graphics here cannot draw into textures that the viewer needs.');
  }

  /** Free it; the texture stays. */
  remove() {
    this._gl.deleteFramebuffer(this._framebuffer);
  }

  /** Draw into it from now on. */
  bind() {
    const gl = this._gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this._framebuffer);
    gl.viewport(0, 0, this.width, this.height);
  }

  /** One triangle over all of it, or over parts: x, y, width and height of each. @param {number[][]} [parts] */
  fill(parts) {
    const gl = this._gl;
    this.bind();
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    gl.bindVertexArray(null);
    if (parts) gl.enable(gl.SCISSOR_TEST);
    for (const [x, y, width, height] of parts ?? [[0, 0, this.width, this.height]]) {
      if (parts) gl.scissor(x, y, width, height);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
    gl.disable(gl.SCISSOR_TEST);
  }
}
