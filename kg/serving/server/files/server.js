// Requests to the server: answers, queries, the feed of changes, and the token, which is kept only in memory.
import { byId } from "/files/page-elements.js";

const JSON_TYPE = "application/json";
const BUSY = [429, 503], RETRIES = 3; // statuses of a server that has no time, and how often it is asked again
const FIRST_PAUSE = 2000, MAX_PAUSE = 30000; // [ms] before the feed is opened again
const GONE = 410; // the status where the server does not keep the missed changes any more
const SILENT = "the server does not answer";
let token = "";

export const useToken = (given) => { token = given; };

export const hasToken = () => token !== "";

/** Wait until the map may be read, a private one by a token; returns its base IRI, which `place` of a public map has. */
export function enter(place) {
  const form = byId("entry");
  if (!form) return Promise.resolve(place.dataset.base);
  byId("entry-token").focus();
  return new Promise((open) => form.addEventListener("submit", async (event) => {
    event.preventDefault();
    useToken(byId("entry-token").value.trim());
    try {
      const { map, base } = await read("/health");
      byId("title").textContent = map;
      document.title = `${map} · hereabouts`;
      form.remove();
      document.querySelector("#links, footer")?.remove(); // its links would send no token
      open(base);
    } catch (error) {
      byId("entry-outcome").textContent = error.message;
    }
  }));
}

/** The answer to a request; `accept` is a media type, and the answer knows the map's transaction `since`.
 * A refusal throws an Error with the server's message and `status`.
 * @param {string} address
 * @param {{accept?: string, method?: string, type?: string, body?: BodyInit, signal?: AbortSignal, since?: number}} [options] */
export async function request(address, { accept = "*/*", method = "GET", type, body, signal, since } = {}) {
  const headers = { Accept: accept };
  if (since) headers["Here-Sequence"] = String(since);
  if (type) headers["Content-Type"] = type;
  if (token) headers.Authorization = `Bearer ${token}`;
  let isAgain = false;
  try {
    for (let left = method === "GET" ? RETRIES : 0; ; left--, isAgain = true) {
      const answer = await fetch(address, { method, headers, body, signal }).catch((error) => { throw error instanceof TypeError ? new Error(SILENT) : error; });
      if (answer.ok) return answer;
      if (!left || !BUSY.includes(answer.status)) throw Object.assign(new Error(await reasonOf(answer)), { status: answer.status });
      window.dispatchEvent(new Event("busy"));
      await new Promise((done) => setTimeout(done, 1000 * Math.min(Number(answer.headers.get("Retry-After")) || 1, 5)));
    }
  } finally {
    if (isAgain) window.dispatchEvent(new Event("answered"));
  }
}

async function reasonOf(answer) {
  const text = await answer.text();
  try {
    const problem = JSON.parse(text);
    return String(problem.detail || problem.title).slice(0, 500);
  } catch {
    return text.trim().slice(0, 500) || `the server answered ${answer.status}`;
  }
}

/** The content of an answer in JSON.
 * @param {string} address
 * @param {{method?: string, body?: string, signal?: AbortSignal}} [options] */
export async function read(address, options = {}) {
  return (await request(address, { ...options, accept: JSON_TYPE, type: options.body && JSON_TYPE })).json();
}

/** The rows of an answer, as texts by columns, at a transaction, or null for the present, which knows the transaction `since`. */
export async function select(query, at = null, since = 0) {
  const answer = await request(at === null ? "/sparql" : `/sparql?at=${at}`, {
    method: "POST", type: "application/sparql-query", accept: "application/sparql-results+json", body: query, since,
  });
  const { results } = await answer.json();
  return results.bindings.map((row) => Object.fromEntries(Object.entries(row).map(([name, { value }]) => [name, value])));
}

/** Follow a map's changes after a transaction: server-sent events, read by fetch since EventSource sends no token.
 *
 * - `onOpen()` and `onClosed()` are called when the connection opens and closes.
 * - `onChange(change)` is called for each change.
 * - `onGap()` is called where changes are missing: it reads the map anew and returns the transaction to go on from.
 */
export async function followChanges(since, { onOpen, onClosed, onChange, onGap }) {
  let sequence = since, pause = FIRST_PAUSE;
  for (;;) {
    try {
      const answer = await request(`/changes?since=${sequence}`, { accept: "text/event-stream" });
      onOpen();
      pause = FIRST_PAUSE;
      await readEvents(answer.body, (change) => {
        sequence = change.sequence;
        try { onChange(change); } catch (error) { reportError(error); } // one that cannot be shown holds up no other
      });
    } catch (error) {
      if (error.status === GONE) sequence = await onGap().catch(() => sequence);
    }
    onClosed();
    await new Promise((done) => setTimeout(done, pause));
    pause = Math.min(2 * pause, MAX_PAUSE);
  }
}

/** Call `take` with the data of each event of a stream, until it ends. */
async function readEvents(body, take) {
  const reader = body.getReader(), decoder = new TextDecoder(); // a TextDecoderStream would be slower on a busy page
  let waiting = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    const events = (waiting + decoder.decode(value, { stream: true })).split("\n\n");
    waiting = events.pop();
    for (const event of events) {
      const found = /^data: (.*)$/m.exec(event); // each event of this feed has one line of data
      if (found) take(JSON.parse(found[1]));
    }
  }
}
