// The bundled library has no types here.
export const autocompletion: any, bracketMatching: any, closeBrackets: any, closeBracketsKeymap: any, completionKeymap: any,
  defaultKeymap: any, drawSelection: any, EditorState: any, EditorView: any, HighlightStyle: any, history: any,
  historyKeymap: any, keymap: any, lineNumbers: any, setDiagnostics: any, sparql: any, StreamLanguage: any,
  syntaxHighlighting: any, tags: any;
