// Completions of the editor: prefixes, terms of the vocabulary, variables, keywords and shipped questions.
import { select } from "/files/server.js";

const TERMS = `SELECT DISTINCT ?iri ?kind ?label WHERE {
  { GRAPH graph:ontology { ?iri a ?kind } FILTER(?kind IN (owl:Class, owl:ObjectProperty, owl:DatatypeProperty, owl:AnnotationProperty))
    OPTIONAL { GRAPH graph:ontology { ?iri rdfs:label ?label } } }
  UNION { { SELECT ?iri WHERE { GRAPH graph:map { ?s ?iri ?o } } LIMIT 20000 } BIND(rdf:Property AS ?kind) } }`;
const KEYWORDS = ["SELECT", "DISTINCT", "WHERE", "GRAPH", "OPTIONAL", "UNION", "MINUS", "FILTER", "BIND", "VALUES", "GROUP BY", "HAVING",
  "ORDER BY", "DESC", "LIMIT", "OFFSET", "COUNT", "SUM", "AVG", "MIN", "MAX", "SAMPLE", "GROUP_CONCAT", "EXISTS", "NOT EXISTS", "CONSTRUCT",
  "DESCRIBE", "ASK", "PREFIX", "STR", "CONTAINS", "LCASE", "REGEX", "COALESCE", "IF", "BOUND", "NOW", "a"];
const GRAPHS = ["graph:map", "graph:ontology", "graph:commonsense", "graph:history", "graph:assertions"];

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
      for (const { iri, kind, label } of (await select(TERMS)).rows) {
        const name = this._compact(iri), type = kind.endsWith("Class") ? "class" : "property";
        if (name && !terms.has(name)) terms.set(name, { label: name, detail: label ? `${type}: ${label}` : type, type });
      }
      return [...terms.values()];
    } catch {
      this._terms = null; // requested again with the next word
      return [];
    }
  }

  _compact(iri) {
    for (const [name, start] of Object.entries(this._prefixes)) {
      const local = iri.slice(start.length);
      if (iri.startsWith(start) && /^[\w-]+$/.test(local)) return `${name}:${local}`;
    }
    return null;
  }
}
