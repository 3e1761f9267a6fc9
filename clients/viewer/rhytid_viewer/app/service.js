// Where skin comes from: a running service, or the package beside the page.

import { Refused, patiently, pause } from "./retry.js";

const KEY = "rhytid-key";
// Milliseconds until a job is asked about again.
const POLL = 250;

/** Whether a text can be a key: what a header takes. @param {string} text */
export function isKey(text) {
  return /^[\x21-\x7e]+$/.test(text);
}

/**
 * What the service says of an asset.
 * @typedef {{id: string, state: string, job: string | null, reason: string | null, vertices: number,
 *   triangles: number, settings: Record<string, any>}} Asset
 * @typedef {{id: string, state: string, progress: number, stage: string, detail: string}} Job
 */

/** Calls of a service. */
export class Service {
  /**
   * @param {URL} root of the service
   * @param {(wrong: boolean) => Promise<string>} askKey asks a person for a key; wrong: the one that
   *   was used is not valid
   */
  constructor(root, askKey) {
    this.root = root;
    this.askKey = askKey;
    /** @type {Promise<string> | null} */
    this.asking = null;
  }

  /** Headers that every call has. @returns {Record<string, string>} */
  headers() {
    const key = sessionStorage.getItem(KEY);
    if (key !== null && !isKey(key)) sessionStorage.removeItem(KEY);
    return key && isKey(key) ? { Authorization: `Bearer ${key}` } : {};
  }

  /** @param {string} path such as v1/assets */
  url(path) {
    return new URL(path, this.root).href;
  }

  /**
   * Ask, with a key where one is needed.
   * @param {string} path
   * @param {RequestInit} [options]
   * @returns {Promise<Response>} a success
   * @throws {Refused} with what the service says; TypeError where it is not reached
   */
  async call(path, options = {}) {
    for (;;) {
      const used = this.headers();
      const given = /** @type {Record<string, string>} */ (options.headers ?? {});
      const answer = await fetch(this.url(path), { ...options, headers: { ...used, ...given } });
      if (answer.ok) return answer;
      if (answer.status !== 401) throw await refused(answer);
      await this.newKey(Boolean(used.Authorization));
    }
  }

  /** Ask for a key, once for all calls that need one. @param {boolean} wrong */
  async newKey(wrong) {
    this.asking ??= this.askKey(wrong).finally(() => (this.asking = null));
    sessionStorage.setItem(KEY, await this.asking);
  }

  /** @returns {Promise<Asset[]>} */
  async assets() {
    return (await this.call("v1/assets")).json();
  }

  /** Whether it answers. @returns {Promise<boolean>} */
  async alive() {
    try {
      const signal = AbortSignal.timeout(5000);
      return (await fetch(this.url("healthz"), { signal, cache: "no-store" })).ok;
    } catch {
      return false;
    }
  }

  /**
   * Files of one package of an asset. A service makes it when it is first asked for. Where the asset
   * changes while its files are read they are refused with status 409.
   * @param {string} asset
   * @param {(job: Job) => void} onMaking
   * @param {AbortSignal} [signal] ends the reading
   * @returns {import('../view/types.js').Read}
   */
  reader(asset, onMaking, signal) {
    /** The package that the first file was of. @type {string | null} */
    let key = null;
    const url = (/** @type {string} */ path) => {
      const query = new URLSearchParams({ levels: "1" }); // coarser ones are not shown
      if (key !== null) query.set("key", key);
      return `v1/assets/${encodeURIComponent(asset)}/package/${path}?${query}`;
    };
    return (path, onProgress) =>
      patiently(async () => {
        for (;;) {
          const answer = await this.call(url(path), { signal });
          if (answer.status !== 202) {
            key ??= answer.headers.get("X-Rhytid-Package");
            return body(answer, onProgress);
          }
          await this.made(await answer.json(), onMaking, signal);
        }
      }, signal);
  }

  /** Until a job has ended. @param {Job} job @param {(job: Job) => void} onProgress @param {AbortSignal} [signal] */
  async made(job, onProgress, signal) {
    let now = job;
    while (now.state === "queued" || now.state === "running") {
      signal?.throwIfAborted();
      onProgress(now);
      await pause(POLL, signal);
      now = await patiently(async () => (await this.call(`v1/jobs/${job.id}`, { signal })).json(), signal);
    }
    if (now.state !== "done") throw new Error(now.detail || `The package was ${now.state}.`);
  }
}

/**
 * Files beside the page, each packed by gzip where the page says so.
 * @param {URL} root
 * @param {boolean} packed
 * @returns {import('../view/types.js').Read}
 */
export function packageReader(root, packed) {
  const read = async (/** @type {string} */ path, /** @type {Parameters<typeof body>[1]} */ onProgress) => {
    const answer = await fetch(new URL(packed ? `${path}.gz` : path, root));
    if (answer.status !== 200) throw new Refused(answer.status, `${path}: the server answers ${answer.status}`);
    const found = await body(answer, onProgress);
    return packed ? unpacked(found) : found;
  };
  return (path, onProgress) => patiently(() => read(path, onProgress));
}

/** A server may have unpacked it already. @param {ArrayBuffer} file @returns {Promise<ArrayBuffer>} */
async function unpacked(file) {
  const [first, second] = new Uint8Array(file);
  if (first !== 0x1f || second !== 0x8b) return file;
  const stream = new Blob([file]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

/** Whether a service gave this page: it tells of itself as JSON. @param {URL} root */
export async function isService(root) {
  const answer = await fetch(root, { headers: { Accept: "application/json" } });
  if (!answer.headers.get("content-type")?.startsWith("application/json")) return null;
  const told = await answer.json();
  return told?.name === "rhytid" ? /** @type {Record<string, string>} */ (told) : null;
}

/**
 * @param {Response} answer
 * @param {((bytes: number, total: number) => void) | undefined} onProgress
 */
async function body(answer, onProgress) {
  if (!onProgress || !answer.body) return answer.arrayBuffer();
  const total = Number(answer.headers.get("content-length") ?? 0);
  const pieces = [];
  let bytes = 0;
  for await (const piece of chunks(answer.body)) {
    pieces.push(piece);
    bytes += piece.length;
    onProgress(bytes, Math.max(total, bytes));
  }
  const out = new Uint8Array(bytes);
  let at = 0;
  for (const piece of pieces) {
    out.set(piece, at);
    at += piece.length;
  }
  return out.buffer;
}

/**
 * @param {ReadableStream<Uint8Array<ArrayBuffer>>} stream
 * @returns {AsyncGenerator<Uint8Array<ArrayBuffer>>}
 */
export async function* chunks(stream) {
  const reader = stream.getReader();
  for (let next = await reader.read(); !next.done; next = await reader.read()) yield next.value;
}

/** @param {Response} answer */
async function refused(answer) {
  let detail = `${answer.status} ${answer.statusText}`;
  try {
    detail = (await answer.json()).detail ?? detail;
  } catch {
    // Not from the service, such as the page of a proxy.
  }
  return new Refused(answer.status, detail);
}
