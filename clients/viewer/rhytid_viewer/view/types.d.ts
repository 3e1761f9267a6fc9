// Types of what `view/` gives. Not read by browsers.

export type Vector = [number, number, number];

/** manifest.json of a skin package, the part that is read here. manifest.schema.json has all of it. */
export interface Manifest {
  format: string;
  version: number;
  asset: string;
  preset: string;
  unit: string;
  unit_in_metres: number | null;
  scale: number;
  resolution: number;
  udims: number[];
  settings: { tile_size?: number; [name: string]: unknown };
  mesh: { file: string; vertices: number; shapes: string[]; centre: number[] };
  blend: { angles: number[]; depth: number; r_max: number; [name: string]: unknown };
  layers: { name: string; samples: number[]; steps: number[]; [name: string]: unknown }[];
  textures: TextureFacts;
  triangles: TextureFacts;
  wrinkles: { textures: TextureFacts; codes: CodeFacts };
  cushion: CushionFacts | null;
  /** Of scanned skin. */
  residual?: { textures: TextureFacts };
  stretch: {
    triangles: number;
    triangles_a_row: number;
    width: number;
    height: number;
    rest: string;
    javascript: string;
    folds: FoldNumbers | null;
  };
  weights: { width: number; height: number; rows: number };
  shaders: Record<string, { vertex: string; passes: Record<string, string> }>;
  texture_bytes: number;
  texture_bytes_of_level_0: number;
}

/** The broad layer: with owners and lines; of packages of before with codes and triangles. */
export interface CushionFacts {
  textures: TextureFacts;
  owners?: TextureFacts;
  lines?: LineFacts;
  codes?: CodeFacts;
  triangles?: TextureFacts;
  [name: string]: unknown;
}

/** What wrinkles answer to stretch by. */
export interface LineFacts {
  files: Record<string, string>;
  width: number;
  height: number;
}

/** Numbers of folds.js. */
export interface FoldNumbers {
  length: number;
  most: number;
  least: number;
  most_bend: number;
  rounds: number;
  normal_rounds: number;
}

/** What the numbers of sets stand for. */
export interface CodeFacts {
  files: Record<string, string>;
  width: number;
}

export interface TextureFacts {
  files: Record<string, string>;
  format: string;
  size: number;
  maps: number;
  pages: number;
  pages_a_row: number;
  levels: number;
}

/** One morph target: x, y, z of every vertex, beside the neutral. */
export interface Shape {
  name: string;
  offsets: Float32Array;
}

/** Vertices are split at UV seams. */
export interface PackageMesh {
  /** x, y, z of every vertex, less `mesh.centre` of the manifest. */
  positions: Float32Array;
  /** Three of every triangle. */
  indices: Uint32Array;
  /** u, v of every vertex, v down. */
  uvs: Float32Array;
  /** The original vertex of each. */
  vertex: Uint32Array;
  shapes: Shape[];
}

/** Level 0 of an array of textures of one channel. */
export interface TextureArray {
  format: 'R8_SNORM' | 'R16_UINT' | 'R32_UINT';
  width: number;
  height: number;
  layers: number;
  texels: Int8Array | Uint16Array | Uint32Array;
}

/** The textures of a UDIM. */
export interface UdimTextures {
  maps: TextureArray;
  triangles: TextureArray;
  wrinkles: TextureArray;
  wrinkleCodes: TextureArray;
  /** Those of the cushions, by the names of their uniforms. */
  cushions: Record<string, TextureArray>;
  /** Of scanned skin. */
  residual: TextureArray | null;
}

/** A skin package in memory. */
export interface SkinPackage {
  manifest: Manifest;
  mesh: PackageMesh;
  /** By UDIM. */
  textures: Map<number, UdimTextures>;
  /** Of stretch.js: 8 doubles of every triangle. */
  rest: Float64Array;
  shaders: { vertex: string; passes: Record<string, string> };
  /** Of all files that were read. */
  bytes: number;
}

/** Bytes of a file of a package; rejects with an Error that says why there are none. */
export type Read = (
  path: string,
  onProgress?: (bytes: number, total: number) => void,
) => Promise<ArrayBuffer>;

export interface LoadProgress {
  /** The file that is read. */
  file: string;
  /** Bytes of all files so far. */
  bytes: number;
  /** Files that are read in full, and how many there are. */
  files: number;
  of: number;
}

export type Method = 'neutral' | 'fast' | 'exact';

export interface ViewOptions {
  /** neutral: skin as it is at rest, on the posed mesh. fast: blended. exact: fast, and the tiles
   * of setExactTile where there are some. */
  method: Method;
  /** Factor of the relief, 1 as it is. */
  strength: number;
  colours: 'skin' | 'stretch';
  /** Principal axes of the stretch. */
  axes: boolean;
  /** Share of the width from the left that shows neutral skin; null for none. */
  split: number | null;
  /** Towards the light, in the axes of the mesh, of any length. */
  light: Vector;
}

export interface TileAddress {
  udim: number;
  level: number;
  row: number;
  column: number;
}

export interface Probe {
  triangle: number;
  udim: number;
  /** Column and row of level 0, row 0 at the top. */
  texel: [number, number];
  /** Mesh units, along the normal. */
  displacement: number;
  /** Ratios of stretch, the larger first. */
  ratios: [number, number];
  /** In the axes of the mesh, with its centre. */
  position: Vector;
}

export interface Statistics {
  /** Of all textures on the GPU, by sum. */
  textureBytes: number;
  /** Of the last pose: stretch in JavaScript. */
  stretchMilliseconds: number;
  /** Of the last draw(), as the caller waits for it. */
  frameMilliseconds: number;
}

/** A colour of the legend of stretch. */
export interface LegendEntry {
  /** Ratio of lengths. */
  ratio: number;
  /** CSS. */
  colour: string;
}
