// Jobs of the engine, as the server tells of them.

/** Whether a job works or waits for its turn. */
export function isActive(job) {
  return job?.state === "running" || job?.state === "waiting";
}
