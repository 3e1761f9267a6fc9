// Sends a mesh and follows the job that grows its skin.

import { byId } from "./dom.js";
import { reason } from "./messages.js";
import { Refused, passing, pause } from "./retry.js";
import { chunks } from "./service.js";

/**
 * @typedef {import('./service.js').Asset} Asset
 * @typedef {import('./service.js').Job} Job
 */

export class Building {
  /** @param {import('./service.js').Service} service */
  constructor(service) {
    this.service = service;
    /** @type {string | null} */
    this.job = null;
    byId("job-cancel", HTMLButtonElement).addEventListener("click", () => {
      if (this.job) this.service.call(`v1/jobs/${this.job}`, { method: "DELETE" }).catch(() => {});
    });
  }

  /**
   * Send a mesh.
   * @param {import('./files_dialog.js').Upload} upload
   * @param {AbortSignal} signal ends it
   * @returns {Promise<Asset>} which the service has taken, built or not
   * @throws {Error} with the file and the reason where it is refused
   */
  async send(upload, signal) {
    const { mesh, shapes, settings } = upload;
    const form = new FormData();
    form.append("mesh", mesh, mesh.name);
    if (shapes) form.append("shapes", shapes, shapes.name);
    form.append("settings", JSON.stringify(settings));
    try {
      this.show(`Sending ${mesh.name}`, 0);
      return await this.post(form, signal);
    } catch (error) {
      throw new Error(named(reason(error), upload), { cause: error });
    } finally {
      this.hide();
    }
  }

  /**
   * Wait until an asset is built.
   * @param {Asset} asset
   * @throws {Error} with the reason where that fails or is cancelled
   */
  async built({ job }) {
    try {
      if (job) await this.follow(job);
    } finally {
      this.hide();
    }
  }

  hide() {
    this.job = null;
    byId("job", HTMLDivElement).hidden = true;
  }

  /**
   * By XMLHttpRequest: fetch does not tell how much is sent.
   * @param {FormData} form
   * @param {AbortSignal} signal
   * @returns {Promise<Asset>}
   */
  post(form, signal) {
    return new Promise((resolve, reject) => {
      const request = new XMLHttpRequest();
      signal.addEventListener("abort", () => request.abort());
      request.onabort = () => reject(signal.reason);
      request.open("POST", this.service.url("v1/assets"));
      for (const [name, value] of Object.entries(this.service.headers())) request.setRequestHeader(name, value);
      request.responseType = "json";
      request.upload.onprogress = ({ loaded, total }) => this.show("Sending", total ? loaded / total : 0);
      request.onerror = () => reject(new Error("The service was not reached."));
      request.onload = () => {
        const answer = request.response;
        if (request.status < 300) resolve(answer);
        else reject(new Refused(request.status, answer?.detail ?? `The service answers ${request.status}.`));
      };
      request.send(form);
    });
  }

  /** Until it ends; asked again where the stream breaks. @param {string} id */
  async follow(id) {
    this.job = id;
    for (;;) {
      const job = await this.listen(id).catch((error) => {
        if (error instanceof Refused && !passing(error)) throw error;
        return null;
      });
      if (job?.state === "done") return;
      if (job?.state === "failed" || job?.state === "cancelled") {
        throw new Error(job.detail || `The build was ${job.state}.`);
      }
      await pause(1000);
    }
  }

  /** @param {string} id @returns {Promise<Job | null>} as it was last told */
  async listen(id) {
    const answer = await this.service.call(`v1/jobs/${id}/events`);
    if (!answer.body) return null;
    const decoder = new TextDecoder();
    let text = "";
    /** @type {Job | null} */
    let job = null;
    for await (const piece of chunks(answer.body)) {
      text += decoder.decode(piece, { stream: true });
      const events = text.split("\n\n");
      text = events.pop() ?? "";
      for (const event of events) {
        const data = /^data: (.*)$/m.exec(event);
        if (!data) continue;
        job = /** @type {Job} */ (JSON.parse(data[1]));
        this.show(job.stage || job.state, job.progress);
      }
    }
    return job;
  }

  /** @param {string} stage @param {number} share */
  show(stage, share) {
    byId("job", HTMLDivElement).hidden = false;
    byId("job-stage", HTMLSpanElement).textContent = `${stage}, ${Math.round(100 * share)} %`;
    byId("job-progress", HTMLProgressElement).value = share;
    byId("job-cancel", HTMLButtonElement).hidden = this.job === null;
  }
}

/**
 * What is wrong, with the file that it is about.
 * @param {string} detail
 * @param {import('./files_dialog.js').Upload} upload
 */
function named(detail, { mesh, shapes }) {
  const file = shapes && /^(part )?shapes\b/.test(detail) ? shapes : mesh;
  return detail.includes(file.name) ? detail : `${file.name}: ${detail}`;
}
