// The query editor: syntax colours, completion of prefixes, terms, variables, keywords and shipped questions, and marked errors.
import { compact } from "/files/result-table.js";
import { select } from "/files/server.js";
import {
  autocompletion, bracketMatching, closeBrackets, closeBracketsKeymap, completionKeymap, defaultKeymap, drawSelection, EditorState,
  EditorView, HighlightStyle, history, historyKeymap, keymap, lineNumbers, setDiagnostics, sparql, StreamLanguage,
  syntaxHighlighting, tags,
} from "/files/vendor/codemirror.min.js";

const TERMS = `SELECT DISTINCT ?iri ?kind ?label WHERE {
  { GRAPH graph:ontology { ?iri a ?kind } FILTER(?kind IN (owl:Class, owl:ObjectProperty, owl:DatatypeProperty, owl:AnnotationProperty))
    OPTIONAL { GRAPH graph:ontology { ?iri rdfs:label ?label } } }
  UNION { { SELECT ?iri WHERE { GRAPH graph:map { ?s ?iri ?o } } LIMIT 20000 } BIND(rdf:Property AS ?kind) } }`;
const KEYWORDS = ["SELECT", "DISTINCT", "WHERE", "GRAPH", "OPTIONAL", "UNION", "MINUS", "FILTER", "BIND", "VALUES", "GROUP BY", "HAVING",
  "ORDER BY", "DESC", "LIMIT", "OFFSET", "COUNT", "SUM", "AVG", "MIN", "MAX", "SAMPLE", "GROUP_CONCAT", "EXISTS", "NOT EXISTS", "CONSTRUCT",
  "DESCRIBE", "ASK", "PREFIX", "STR", "CONTAINS", "LCASE", "REGEX", "COALESCE", "IF", "BOUND", "NOW", "a"];
const GRAPHS = ["graph:map", "graph:ontology", "graph:commonsense", "graph:history", "graph:assertions"];

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
}

export class SparqlCompletion {
  /** `prefixes` are IRIs by name, `questions` is the list of `/queries`; `onQuestion(name)` opens a question. */
  constructor(prefixes, questions, onQuestion) {
    this._prefixes = prefixes;
    this._words = [
      ...KEYWORDS.map((label) => ({ label, type: "keyword" })),
      ...Object.entries(prefixes).map(([name, iri]) => ({ label: `${name}:`, detail: iri, type: "namespace" })),
      ...GRAPHS.map((label) => ({ label, detail: "named graph", type: "namespace" })),
      ...questions.map(({ name, summary }) => ({
        label: name, detail: `question: ${summary}`, type: "text", boost: -1,
        apply: (view, _chosen, from, to) => { view.dispatch({ changes: { from, to } }); onQuestion(name); },
      })),
    ];
    this._terms = null;
  }

  /** A source of completions for CodeMirror's `autocompletion`. */
  async complete(context) {
    const word = context.matchBefore(/[?$]\w*|[\w-]*:?[\w-]*/);
    if (!word || (word.from === word.to && !context.explicit)) return null;
    const validFor = /^[?$]?[\w:-]*$/;
    if (/^[?$]/.test(word.text)) return { from: word.from, options: this._variables(context, word), validFor };
    this._terms ??= this._readTerms();
    return { from: word.from, options: [...(await this._terms), ...this._words], validFor };
  }

  _variables(context, word) {
    const others = context.state.doc.toString().matchAll(/[?$]\w+/g), names = new Set();
    for (const one of others) if (one.index !== word.from) names.add(one[0]);
    return [...names].map((label) => ({ label, type: "variable" }));
  }

  async _readTerms() {
    try {
      const terms = new Map();
      for (const { iri, kind, label } of await select(TERMS)) {
        const [name] = /^[\w-]+:[\w-]+$/.exec(compact(iri, iri, this._prefixes)) ?? [""], type = kind.endsWith("Class") ? "class" : "property";
        if (name && !terms.has(name)) terms.set(name, { label: name, detail: label ? `${type}: ${label}` : type, type });
      }
      return [...terms.values()];
    } catch {
      this._terms = null; // requested again with the next word
      return [];
    }
  }

}
