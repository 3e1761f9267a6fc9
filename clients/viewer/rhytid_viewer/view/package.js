// Reads a skin package.

import { readRest } from '../stretch.js';
import { readGlb } from './glb.js';
import { readKtx2 } from './ktx2.js';

/** @typedef {import('./types.js').SkinPackage} SkinPackage */
/** @typedef {import('./types.js').Manifest} Manifest */
/** @typedef {import('./types.js').TextureFacts} TextureFacts */
/** @typedef {import('./types.js').UdimTextures} UdimTextures */
/** @typedef {(path: string) => Promise<ArrayBuffer>} ReadFile */

const DIALECT = 'glsl-es-300';
// 1: of before cushions had owners. 3: of scanned skin.
const VERSIONS = [1, 2, 3];
const PARTS = ['mesh', 'blend', 'layers', 'textures', 'triangles', 'wrinkles', 'stretch', 'weights', 'shaders'];

/**
 * Read all files of a package; level 0 of its maps alone.
 * @param {import('./types.js').Read} read by path in the package
 * @param {(progress: import('./types.js').LoadProgress) => void} [onProgress]
 * @returns {Promise<SkinPackage>}
 * @throws {Error} that names the file and what is wrong with it
 */
export async function loadPackage(read, onProgress) {
  const counter = new Counter(read, onProgress ?? (() => {}));
  /** @type {ReadFile} */
  const readFile = (path) => counter.read(path);
  const manifest = await parsed('manifest.json', readFile, readManifest);
  counter.of = filesOf(manifest);
  const [mesh, rest, shaders, textures] = await Promise.all([
    parsed(manifest.mesh.file, readFile, readGlb),
    parsed(manifest.stretch.rest, readFile, readRest),
    readShaders(manifest, readFile),
    readTextures(manifest, readFile),
  ]).catch((error) => {
    counter.quiet(); // files that are still read must not hide what is wrong
    throw error;
  });
  checkSizes(manifest, mesh, rest);
  return { manifest, mesh, rest, shaders, textures, bytes: counter.bytes };
}

class Counter {
  /**
   * @param {import('./types.js').Read} read
   * @param {(progress: import('./types.js').LoadProgress) => void} onProgress
   */
  constructor(read, onProgress) {
    this._read = read;
    this._onProgress = onProgress;
    /** @type {Map<string, number>} */
    this._sizes = new Map();
    this._files = 0;
    this.of = 1;
  }

  /** Tell of nothing more. */
  quiet() {
    this._onProgress = () => {};
  }

  get bytes() {
    return [...this._sizes.values()].reduce((sum, size) => sum + size, 0);
  }

  /** @param {string} path */
  async read(path) {
    const found = await this._read(path, (bytes) => this._tell(path, bytes));
    this._files += 1;
    this._tell(path, found.byteLength);
    return found;
  }

  /** @param {string} file @param {number} size of it, so far */
  _tell(file, size) {
    this._sizes.set(file, size);
    this._onProgress({ file, bytes: this.bytes, files: this._files, of: this.of });
  }
}

/**
 * What a file holds; errors name it.
 * @template T
 * @param {string} path
 * @param {ReadFile} readFile
 * @param {(bytes: ArrayBuffer) => T} parse
 */
async function parsed(path, readFile, parse) {
  const bytes = await readFile(path);
  try {
    return parse(bytes);
  } catch (error) {
    throw new Error(`${path}: ${error instanceof Error ? error.message : error}`, { cause: error });
  }
}

/** @param {ArrayBuffer} bytes @returns {Manifest} */
function readManifest(bytes) {
  const found = JSON.parse(text(bytes));
  if (found.format !== 'rhytid-skin') throw new Error('is no manifest of a skin package');
  if (!VERSIONS.includes(found.version)) throw new Error(`version ${found.version} of skin packages is not known here`);
  for (const part of PARTS)
    if (!found[part]) throw new Error(`has no ${part}: another version of rhytid wrote this package`);
  if (found.version === 3 && !found.residual) throw new Error('has no residual, which a scanned skin must have');
  if (!found.shaders?.[DIALECT]) throw new Error(`has no shaders of ${DIALECT}`);
  return found;
}

/** @param {ArrayBuffer} bytes */
function text(bytes) {
  return new TextDecoder().decode(bytes);
}

/** @param {Manifest} manifest */
function filesOf(manifest) {
  const arrays = 4 + (manifest.cushion ? 3 : 0) + (manifest.residual ? 1 : 0); // of cushions of every kind three
  const passes = Object.keys(manifest.shaders[DIALECT].passes).length;
  return 4 + passes + arrays * manifest.udims.length;
}

/** @param {Manifest} manifest @param {ReadFile} readFile */
async function readShaders(manifest, readFile) {
  const { vertex, passes } = manifest.shaders[DIALECT];
  const entries = Object.entries(passes).map(async ([name, file]) => [name, text(await readFile(file))]);
  return { vertex: text(await readFile(vertex)), passes: Object.fromEntries(await Promise.all(entries)) };
}

/** @param {Manifest} manifest @param {ReadFile} readFile */
async function readTextures(manifest, readFile) {
  /** @type {Map<number, UdimTextures>} */
  const found = new Map();
  for (const udim of manifest.udims) {
    /** @param {TextureFacts} facts */
    const array = (facts) => readArray(facts, udim, readFile);
    /** @param {import('./types.js').CodeFacts} facts */
    const codes = (facts) => readCodes(facts, udim, readFile);
    const { cushion, residual: scanned, wrinkles: bins } = manifest;
    const [maps, triangles, wrinkles, wrinkleCodes, cushions, residual] = await Promise.all([
      array(manifest.textures),
      array(manifest.triangles),
      array(bins.textures),
      codes(bins.codes),
      readCushions(cushion, udim, readFile),
      scanned ? array(scanned.textures) : null,
    ]);
    found.set(udim, { maps, triangles, wrinkles, wrinkleCodes, cushions, residual });
  }
  return found;
}

/**
 * The textures of the cushions by the names of their uniforms.
 * @param {import('./types.js').CushionFacts | null} cushion
 * @param {number} udim
 * @param {ReadFile} readFile
 */
async function readCushions(cushion, udim, readFile) {
  /** @type {Record<string, Promise<import('./types.js').TextureArray>>} */
  const asked = {};
  if (cushion) asked.rhytid_cushions = readArray(cushion.textures, udim, readFile);
  if (cushion?.owners) asked.rhytid_cushion_owners = readArray(cushion.owners, udim, readFile);
  if (cushion?.lines) asked.rhytid_cushion_lines = readLines(cushion.lines, udim, readFile);
  if (cushion?.codes) asked.rhytid_cushion_codes = readCodes(cushion.codes, udim, readFile);
  if (cushion?.triangles) asked.rhytid_cushion_triangles = readArray(cushion.triangles, udim, readFile);
  const entries = Object.entries(asked).map(async ([name, array]) => [name, await array]);
  return Object.fromEntries(await Promise.all(entries));
}

/** @param {import('./types.js').LineFacts} facts @param {number} udim @param {ReadFile} readFile */
async function readLines(facts, udim, readFile) {
  const file = fileOf(facts.files, udim);
  const found = await parsed(file, readFile, readKtx2);
  const { width, height, layers, format } = found;
  if (width !== facts.width || height > facts.height || layers !== 4 || format !== 'R32_UINT')
    throw new Error(`${file}: ${width} x ${height} x ${layers} texels of ${format}, not what manifest.json says`);
  return found;
}

/** @param {Record<string, string>} files @param {number} udim */
function fileOf(files, udim) {
  const file = files[udim];
  if (!file) throw new Error(`manifest.json: names no file of UDIM ${udim}`);
  return file;
}

/** @param {import('./types.js').CodeFacts} facts @param {number} udim @param {ReadFile} readFile */
async function readCodes(facts, udim, readFile) {
  const file = fileOf(facts.files, udim);
  const found = await parsed(file, readFile, readKtx2);
  if (found.width !== facts.width || found.format !== 'R8_SNORM')
    throw new Error(`${file}: rows of ${found.width} texels of ${found.format}, not what manifest.json says`);
  return found;
}

/** @param {TextureFacts} facts @param {number} udim @param {ReadFile} readFile */
async function readArray(facts, udim, readFile) {
  const file = fileOf(facts.files, udim);
  const found = await parsed(file, readFile, readKtx2);
  const { width, height, layers, format } = found;
  const same = width === facts.size && height === facts.size && layers === facts.maps * facts.pages;
  // Of several UDIMs some may need fewer bytes for their numbers.
  const narrower = format === 'R16_UINT' && facts.format === 'R32_UINT';
  if (!same || (format !== facts.format && !narrower))
    throw new Error(`${file}: ${width} x ${height} x ${layers} texels of ${format}, not what manifest.json says`);
  return found;
}

/**
 * @param {Manifest} manifest
 * @param {import('./types.js').PackageMesh} mesh
 * @param {Float64Array} rest
 */
function checkSizes(manifest, mesh, rest) {
  const { triangles } = manifest.stretch;
  if (mesh.indices.length !== 3 * triangles)
    throw new Error(`${manifest.mesh.file}: ${mesh.indices.length / 3} triangles, manifest.json says ${triangles}`);
  if (rest.length !== 8 * triangles)
    throw new Error(`${manifest.stretch.rest}: ${rest.length / 8} triangles, manifest.json says ${triangles}`);
  if (mesh.positions.length < 3 * manifest.mesh.vertices)
    throw new Error(`${manifest.mesh.file}: fewer vertices than manifest.json says`);
}
