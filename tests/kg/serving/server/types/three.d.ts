// The bundled library has no types here.
declare const three: any;
export = three;
