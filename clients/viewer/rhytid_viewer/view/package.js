// Reads a skin package.

/** @typedef {import('./types.js').SkinPackage} SkinPackage */

/**
 * Read all files of a package; level 0 of its maps alone.
 * @param {import('./types.js').Read} read by path in the package
 * @param {(progress: import('./types.js').LoadProgress) => void} [onProgress]
 * @returns {Promise<SkinPackage>}
 * @throws {Error} that names the file and what is wrong with it
 */
export async function loadPackage(read, onProgress) {
  void read;
  void onProgress;
  throw new Error('not written yet');
}
