// The time of each recording, shared by its player and by every chart over its time.
const Time = (() => {
  const listeners = new Map();
  const last = new Map();
  // calls `hear(seconds, from)` when someone else sets the time; at once if it was set before
  const on = (recording, who, hear) => {
    if (!recording) return;
    if (!listeners.has(recording)) listeners.set(recording, new Map());
    listeners.get(recording).set(who, hear);
    if (last.has(recording)) hear(last.get(recording));
  };
  const off = (recording, who) => listeners.get(recording)?.delete(who);
  const set = (recording, seconds, who) => {
    if (!recording || !Number.isFinite(seconds)) return;
    last.set(recording, seconds);
    listeners.get(recording)?.forEach((hear, listener) => { if (listener !== who) hear(seconds); });
  };
  return { on, off, set };
})();
