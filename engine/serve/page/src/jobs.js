// Jobs of the engine, as the server tells of them.
import { t } from "./language.js";

/** Whether a job works or waits for its turn. */
export function isActive(job) {
  return job?.state === "running" || job?.state === "waiting";
}

/** What a job does, such as "Isolate vase". */
export function jobName(job) {
  return t(job.label, job.subject);
}
