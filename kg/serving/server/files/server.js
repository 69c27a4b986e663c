// Requests to the server. The token is kept only in memory, as long as the page is open.

const NUMBERS = new Set(["x", "y", "z", "existence", "deviation", "dx", "dy", "dz", "yaw", "count", "heading", "xmin", "xmax",
  "ymin", "ymax", "share", "belief", "size", "storey"]);
const BUSY = [429, 503], RETRIES = 3; // statuses of a server that has no time, and how often it is asked again
let token = "";

export function useToken(given) {
  token = given;
}

export function hasToken() {
  return token !== "";
}

export function isNumber(column) {
  return NUMBERS.has(column);
}

/** The answer to a request; `accept` is a media type. A refusal throws an Error with the server's message and `status`.
 * @param {string} address
 * @param {{accept?: string, method?: string, type?: string, body?: BodyInit, signal?: AbortSignal}} [options] */
export async function request(address, { accept = "*/*", method = "GET", type, body, signal } = {}) {
  const headers = { Accept: accept };
  if (type) headers["Content-Type"] = type;
  if (token) headers.Authorization = `Bearer ${token}`;
  let isAgain = false;
  try {
    for (let left = method === "GET" ? RETRIES : 0; ; left--, isAgain = true) {
      const answer = await fetch(address, { method, headers, body, signal });
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

/** What a page draws at a moment (ISO 8601 or the number of a transaction), or now; perhaps without objects.
 * @param {string | null} at
 * @param {{signal?: AbortSignal, objects?: boolean}} [options] */
export async function stateAt(at, { signal, objects = true } = {}) {
  const given = new URLSearchParams({ ...(at === null ? {} : { at }), ...(objects ? {} : { objects: "0" }) });
  return (await request(`/state?${given}`, { accept: "application/json", signal })).json();
}

/** The answer to a query: {rows, sequence}; `at` is a transaction number, or null for the present. */
export async function select(query, at = null) {
  const answer = await request(at === null ? "/sparql" : `/sparql?at=${at}`, {
    method: "POST", type: "application/sparql-query", accept: "application/sparql-results+json", body: query,
  });
  const { results } = await answer.json(), plain = ([name, { value }]) => [name, isNumber(name) ? Number(value) : value];
  const rows = results.bindings.map((row) => Object.fromEntries(Object.entries(row).map(plain)));
  return { rows, sequence: Number(answer.headers.get("Here-Sequence") || 0) };
}
