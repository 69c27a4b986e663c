// The feed of changes: server-sent events read by fetch, since EventSource cannot send a token.
import { request } from "/files/server.js";

const FIRST_PAUSE = 2000, MAX_PAUSE = 30000; // [ms] before a reconnection
const GONE = 410; // the status where the server does not keep the missed changes any more

/** Follow a map's changes after a transaction, as long as the page is open.
 *
 * - `onOpen()` and `onClosed()` are called when the connection opens and closes.
 * - `onChange(change)` is called for each change.
 * - `onGap()` is called where changes are missing: it reads the map again and returns the transaction to continue from.
 */
export async function followChanges(since, { onOpen, onClosed, onChange, onGap }) {
  let sequence = since, pause = FIRST_PAUSE;
  for (;;) {
    try {
      const answer = await request(`/changes?since=${sequence}`, { accept: "text/event-stream" });
      onOpen();
      pause = FIRST_PAUSE;
      await readEvents(answer.body, (change) => { sequence = change.sequence; onChange(change); });
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
      const data = event.split("\n").filter((line) => line.startsWith("data: ")).map((line) => line.slice(6));
      if (data.length) take(JSON.parse(data.join("\n")));
    }
  }
}
