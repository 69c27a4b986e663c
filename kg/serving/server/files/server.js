// Requests to the server. The token is kept only in memory, as long as the page is open.

const NUMBERS = new Set(["x", "y", "z", "existence", "deviation", "dx", "dy", "dz", "yaw", "count", "heading", "xmin", "xmax",
  "ymin", "ymax", "share", "belief", "size", "storey"]);
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
  const answer = await fetch(address, { method, headers, body, signal });
  if (!answer.ok) throw Object.assign(new Error(await reasonOf(answer)), { status: answer.status });
  return answer;
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
    method: "POST", type: "application/sparql-query", accept: "text/csv", body: query,
  });
  return { rows: rowsOf(await answer.text()), sequence: Number(answer.headers.get("Here-Sequence") || 0) };
}

/** Rows of CSV text (RFC 4180) as objects by column. */
function rowsOf(text) {
  const rows = [];
  let row = [], cell = "", quoted = false;
  for (let i = 0; i < text.length; i++) {
    const c = text[i];
    if (quoted) {
      if (c === '"' && text[i + 1] === '"') { cell += '"'; i++; } else if (c === '"') quoted = false;
      else cell += c;
    } else if (c === '"') quoted = true;
    else if (c === ",") { row.push(cell); cell = ""; }
    else if (c === "\n") { row.push(cell); rows.push(row); row = []; cell = ""; }
    else if (c !== "\r") cell += c;
  }
  const columns = rows.shift() || [];
  return rows.map((cells) => {
    const made = {};
    columns.forEach((name, n) => {
      if (cells[n] !== "") made[name] = isNumber(name) ? Number(cells[n]) : cells[n];
    });
    return made;
  });
}
