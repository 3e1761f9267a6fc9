// Asks again where a failure may pass.

// Milliseconds until each next attempt.
const WAITS = [300, 600, 1200, 2400];
const PASSING = [429, 502, 503, 504];

/** An answer that is no success. */
export class Refused extends Error {
  /** @param {number} status @param {string} detail */
  constructor(status, detail) {
    super(detail);
    this.status = status;
  }
}

/**
 * Whether the same question may have an answer later: who answers is busy, or was not reached.
 * @param {unknown} error
 */
export function passing(error) {
  return error instanceof Refused ? PASSING.includes(error.status) : error instanceof TypeError;
}

/**
 * What a call that changes nothing gives, asked up to five times in 4.5 s.
 * @template T
 * @param {() => Promise<T>} ask
 * @param {AbortSignal} [signal] ends the waiting too
 * @returns {Promise<T>}
 * @throws {unknown} what was thrown last
 */
export async function patiently(ask, signal) {
  for (const wait of WAITS) {
    try {
      return await ask();
    } catch (error) {
      if (signal?.aborted || !passing(error)) throw error;
    }
    await pause(wait, signal);
  }
  return ask();
}

/**
 * @param {number} milliseconds
 * @param {AbortSignal} [signal]
 * @throws {unknown} the reason of the signal, once it is aborted
 */
export async function pause(milliseconds, signal) {
  await new Promise((resolve) => setTimeout(resolve, milliseconds));
  signal?.throwIfAborted();
}
