// The query editor: syntax colours, completion, and marked errors.
import {
  autocompletion, bracketMatching, closeBrackets, closeBracketsKeymap, completionKeymap, defaultKeymap, drawSelection, EditorState,
  EditorView, HighlightStyle, history, historyKeymap, keymap, lineNumbers, setDiagnostics, sparql, StreamLanguage,
  syntaxHighlighting, tags,
} from "/files/vendor/codemirror.min.js";

const THEME = EditorView.theme({
  "&": { color: "var(--ink)", backgroundColor: "var(--paper)", border: "1px solid var(--line)", borderRadius: "7px", fontSize: "13.5px" },
  "&.cm-focused": { outline: "3px solid var(--accent)", outlineOffset: "2px" },
  ".cm-scroller": { fontFamily: 'ui-monospace, "DejaVu Sans Mono", monospace', maxHeight: "24rem", minHeight: "11rem" },
  ".cm-gutters": { backgroundColor: "transparent", color: "var(--faint)", border: "0" },
  ".cm-cursor": { borderLeftColor: "var(--ink)" },
  ".cm-selectionBackground, &.cm-focused .cm-selectionBackground": { backgroundColor: "var(--selection) !important" },
  ".cm-tooltip": { color: "var(--ink)", backgroundColor: "var(--panel)", border: "1px solid var(--line)" },
  ".cm-tooltip-autocomplete ul li[aria-selected]": { color: "var(--panel)", backgroundColor: "var(--accent)" },
  ".cm-lintRange-error": { backgroundImage: "none", textDecoration: "underline wavy var(--wrong)" },
  ".cm-diagnostic-error": { borderLeft: "4px solid var(--wrong)" },
  ".cm-completionDetail": { fontStyle: "normal", opacity: "0.75" },
});
const COLOURS = HighlightStyle.define([
  { tag: tags.keyword, color: "var(--keyword)", fontWeight: "600" },
  { tag: [tags.variableName, tags.special(tags.variableName), tags.local(tags.variableName)], color: "var(--variable)" },
  { tag: [tags.atom, tags.string], color: "var(--string)" },
  { tag: [tags.number, tags.bool], color: "var(--number)" },
  { tag: tags.comment, color: "var(--faint)", fontStyle: "italic" },
  { tag: tags.invalid, color: "var(--wrong)" },
]);

/** Replace a selection by typed text: a browser would add inline styles, which the CSP refuses. */
function typeOver(event, view) {
  const { from, to, empty } = view.state.selection.main;
  if (event.inputType !== "insertText" || empty || view.composing) return false;
  const insert = () => view.state.update(view.state.replaceSelection(event.data), { userEvent: "input.type", scrollIntoView: true });
  const handlers = view.state.facet(EditorView.inputHandler);
  if (!handlers.some((handle) => handle(view, from, to, event.data, insert))) view.dispatch(insert());
  return true;
}

export class QueryEditor {
  /** An editor in `place` that calls `onAsk()`; `complete` is a source of completions of CodeMirror. */
  constructor(place, text, { onAsk, complete }) {
    // in a shadow tree CodeMirror uses constructed style sheets, which a strict CSP allows
    const root = place.attachShadow({ mode: "open" });
    this._view = new EditorView({
      root,
      parent: root,
      state: EditorState.create({ doc: text, extensions: [
        lineNumbers(), history(), drawSelection(), bracketMatching(), closeBrackets(),
        StreamLanguage.define(sparql), syntaxHighlighting(COLOURS), THEME,
        autocompletion({ override: [complete], icons: false }),
        EditorView.domEventHandlers({ beforeinput: typeOver }),
        EditorView.contentAttributes.of({ "aria-label": "SPARQL", spellcheck: "false" }),
        keymap.of([{ key: "Mod-Enter", run: () => { onAsk(); return true; } },
          ...closeBracketsKeymap, ...completionKeymap, ...defaultKeymap, ...historyKeymap]),
      ] }),
    });
  }

  get text() {
    return this._view.state.doc.toString();
  }

  set text(text) {
    this._view.dispatch({ changes: { from: 0, to: this._view.state.doc.length, insert: text } });
    this.unmark();
  }

  /** Mark the word at or before a line and column (counted from 1), and put the cursor there. */
  mark(line, column, message) {
    const { doc } = this._view.state, at = doc.line(Math.min(Math.max(line, 1), doc.lines));
    const reached = Math.min(Math.max(column - 1, 0), at.length);
    const start = at.text.slice(0, reached).search(/[^\s{}();.]+\s*$|\S\s*$/);
    const from = at.from + Math.max(start, 0);
    const to = Math.max(from + /^([^\s{}();.]+|\S?)/.exec(at.text.slice(from - at.from))[0].length, Math.min(at.from + reached, at.to));
    this._view.dispatch(setDiagnostics(this._view.state, [{ from, to, severity: "error", message }]));
    this._view.dispatch({ selection: { anchor: to }, scrollIntoView: true });
  }

  unmark() {
    this._view.dispatch(setDiagnostics(this._view.state, []));
  }

  focus() {
    this._view.focus();
  }
}
