"""Work inside a worker: queries, updates, documents, the history, ontologies.

Its parent sends requests to its stdin and reads the answers from its stdout. A message has a type
byte, a length (4 bytes, little endian) and that many bytes:

    >  S  the settings (JSON), first       <  R  ready for requests: the confinement
    >  Q  a query (JSON), perhaps of then  <  H  {"media_type", "sequence", ...}
    >  U  an update (JSON) to evaluate     <  D  a part of the answer
    >  L  an RDF document to parse         <  .  the end of the answer
    >  T  a report on the history          <  E  {"error": name of the exception, "message"}
    >  G  all graphs to serialise
    >  P  a past state to make
    >  V  the state of the map that a page draws, perhaps of then
    >  N  a new ontology (an RDF document) for the map
"""

import struct

HEAD = struct.Struct("<cI")
