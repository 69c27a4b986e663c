// The feed of changes: server-sent events by fetch, which unlike EventSource can carry a token.
import { request } from "/files/server.js";

const FIRST_PAUSE = 2000, LONGEST_PAUSE = 30000; // [ms] before it is asked for again
const GONE = 410; // what lies between is not kept any more

/** Follow a map's changes from a transaction on, for as long as the page is open.
 *
 * `onOpen()` and `onClosed()` tell of the connection, `onChange(change)` is called for each change, and `onGap()` where
 * changes are missing: it reads the map anew and returns the transaction to go on from.
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
    pause = Math.min(2 * pause, LONGEST_PAUSE);
  }
}

/** Call `take` with the data of each event of a stream, until it ends. */
async function readEvents(body, take) {
  const reader = body.getReader(), decoder = new TextDecoder(); // a TextDecoderStream would take more turns of a busy page
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
