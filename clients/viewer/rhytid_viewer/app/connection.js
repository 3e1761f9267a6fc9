// Whether the service answers: asked now and then, and again and again while it does not.

const QUIET = 5000;
const WAITS = [300, 600, 1200, 2500, 5000];

export class Connection {
  /**
   * @param {import('./service.js').Service} service
   * @param {(online: boolean) => void} onChange
   */
  constructor(service, onChange) {
    this.service = service;
    this.onChange = onChange;
    this.online = true;
    this.failures = 0;
    this.timer = 0;
    document.addEventListener("visibilitychange", () => document.hidden || this.check());
    this.later(QUIET);
  }

  /** @param {number} milliseconds */
  later(milliseconds) {
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.check(), milliseconds);
  }

  /** Ask now, such as after a call that failed. */
  async check() {
    if (document.hidden && this.online) {
      this.later(QUIET);
      return;
    }
    const online = await this.service.alive();
    this.failures = online ? 0 : this.failures + 1;
    this.later(online ? QUIET : WAITS[Math.min(this.failures, WAITS.length) - 1]);
    if (online !== this.online) {
      this.online = online;
      this.onChange(online);
    }
  }
}
