"""All IRIs that the code names; no other module contains an IRI.

Named graphs, datatypes and rdf:type are `NamedNode`s, as in quads. Other terms are strings, as in
records and tables. All names are `Final`, so that type checkers report a misspelt one. Object and
place categories are data (`ontologies/`), not constants.
"""

from __future__ import annotations

import re
from typing import Final, Literal

from pyoxigraph import NamedNode

HERE: Final = "https://w3id.org/hereabouts#"
GRAPH: Final = "https://w3id.org/hereabouts/graph/"
CELL: Final = "https://w3id.org/hereabouts/cell/"
RELATION: Final = "https://w3id.org/hereabouts/relation/"
#: the ontology that declares the terms of maps
CORE_ONTOLOGY: Final = "https://w3id.org/hereabouts/ontology/hereabouts"
#: prefix of IRIs that replace blank nodes in a map (RDF 1.1 Concepts, section 3.5)
GENID: Final = "https://w3id.org/.well-known/genid/hereabouts/"
ROOM_TYPE: Final = "https://w3id.org/hereabouts/room/"  # kinds of rooms that statistics bring
STATISTICS: Final = "https://w3id.org/hereabouts/statistics/"
ROOMS_ONTOLOGY: Final = "https://w3id.org/hereabouts/ontology/rooms/"  # + the source

#: + kind#name: category of a detector's label that no other category has
PROVISIONAL: Final = "https://w3id.org/hereabouts/provisional/"
#: + name of a WordNet sense: class of the things of a word (`kg.knowledge.words.classes`)
WORD: Final = "https://w3id.org/hereabouts/word/"
WORD_SOURCE: Final = "WordNet 3.0"  # dct:source of such a class, unless a network has the word

# named graphs
ONTOLOGY_GRAPH: Final = NamedNode(GRAPH + "ontology")
COMMONSENSE_GRAPH: Final = NamedNode(GRAPH + "commonsense")
MAP_GRAPH: Final = NamedNode(GRAPH + "map")
HISTORY_GRAPH: Final = NamedNode(GRAPH + "history")
ASSERTIONS_GRAPH: Final = NamedNode(GRAPH + "assertions")
DATASET_GRAPH: Final = NamedNode(GRAPH + "dataset")
#: superclasses of the classes that things state (`kg.store.type_inference`)
INFERRED_GRAPH: Final = NamedNode(GRAPH + "inferred")
#: of a mirror: the last published transaction of each map
PUBLISHED_GRAPH: Final = NamedNode(GRAPH + "published")

# classes
OBJECT: Final = HERE + "Object"
PLACE: Final = HERE + "Place"
ROBOT: Final = HERE + "Robot"
SEMANTIC_MAP: Final = HERE + "SemanticMap"
RECORDING: Final = HERE + "Recording"
PLACE_BELIEF: Final = HERE + "PlaceBelief"
LABEL_BELIEF: Final = HERE + "LabelBelief"
DEPARTED_OBJECT: Final = HERE + "DepartedObject"
UNNAMED_THING: Final = HERE + "UnnamedThing"
FRAME_CLASS: Final = HERE + "CoordinateFrame"
LOCATED_AT_RELATION: Final = HERE + "LocatedAtRelation"
NEAR_BY_RELATION: Final = HERE + "NearByRelation"

# between classes: annotation properties, as Protege shows and edits them
LOCATED_AT: Final = HERE + "locatedAt"
NEAR_BY: Final = HERE + "nearBy"
PROBABILITY: Final = HERE + "probability"
USED_FOR: Final = HERE + "usedFor"
ALSO_USED_FOR: Final = HERE + "alsoUsedFor"
CARRIES: Final = HERE + "carries"  # here:on, here:inside
BACK_HEIGHT: Final = HERE + "backHeight"

PROVISIONAL_MARK: Final = HERE + "provisional"
MARKER: Final = HERE + "marker"

# provenance of an imported relation, by which later edits by hand are recognised
WEIGHT: Final = HERE + "weight"
WEIGHT_AGAINST: Final = HERE + "weightAgainst"
SURFACE_TEXT: Final = HERE + "surfaceText"
IMPORT_MARK: Final = HERE + "importMark"
IMPORTED_RELATIONS: Final = HERE + "importedRelations"

# compiled view of the ontology (graph:commonsense), for queries
IS_A: Final = HERE + "isA"  # reflexive, transitive closure of rdfs:subClassOf
RELATION_SUBJECT: Final = HERE + "relationSubject"
RELATION_TARGET: Final = HERE + "relationTarget"
RELATION_PROBABILITY: Final = HERE + "relationProbability"

# statistics of real rooms (graph:ontology)
ROOM_STATISTICS: Final = HERE + "RoomStatistics"
STATISTICS_OBJECT: Final = HERE + "statisticsObject"
STATISTICS_PLACE: Final = HERE + "statisticsPlace"
ROOM_COUNT: Final = HERE + "roomCount"
ROOMS_WITH_OBJECT: Final = HERE + "roomsWithObject"

# individuals: position
X: Final = HERE + "x"
Y: Final = HERE + "y"
Z: Final = HERE + "z"
HEADING: Final = HERE + "heading"
X_MIN: Final = HERE + "xMin"
X_MAX: Final = HERE + "xMax"
Y_MIN: Final = HERE + "yMin"
Y_MAX: Final = HERE + "yMax"
OUTLINE: Final = HERE + "outline"  # of a place that is no rectangle
IN_PLACE: Final = HERE + "inPlace"
IN_CELL: Final = HERE + "inCell"
EXTENT_X: Final = HERE + "extentX"
EXTENT_Y: Final = HERE + "extentY"
EXTENT_Z: Final = HERE + "extentZ"
YAW: Final = HERE + "yaw"
DEVIATION: Final = HERE + "positionDeviation"

FROM_FLOOR: Final = HERE + "fromFloor"  # of a place found in the mapped floor
DOOR: Final = HERE + "Door"
WIDTH: Final = HERE + "width"

# individuals: relations
SPATIAL_RELATION: Final = HERE + "SpatialRelation"
SPATIAL: Final = HERE + "spatialRelation"  # super-property of the next three
ON: Final = HERE + "on"
INSIDE: Final = HERE + "inside"
BESIDE: Final = HERE + "beside"
HAS_RELATION: Final = HERE + "hasRelation"
OF_RELATION: Final = HERE + "ofRelation"  # here:on, here:inside or here:beside
RELATED_TO: Final = HERE + "relatedTo"
#: inverses of here:on, here:inside and here:inPlace, for reasoners; no map states them
SUPPORTS: Final = HERE + "supports"
HOLDS: Final = HERE + "holds"
HAS_OBJECT: Final = HERE + "hasObject"

# individuals: confidence, counts and times
CONFIDENCE: Final = HERE + "confidence"  # the thesis' C, between 0 and nu
EXISTENCE: Final = HERE + "existence"
OBSERVATION_COUNT: Final = HERE + "observationCount"
FIRST_SEEN: Final = HERE + "firstSeen"
LAST_SEEN: Final = HERE + "lastSeen"
FOUND_GONE: Final = HERE + "foundGone"  # this and the next: of departed objects
PEAK_EXISTENCE: Final = HERE + "peakExistence"

# individuals: alternative categories
HAS_LABEL_BELIEF: Final = HERE + "hasLabelBelief"
LABEL_PROBABILITY: Final = HERE + "labelProbability"

# places
HAS_BELIEF: Final = HERE + "hasBelief"
OF_CATEGORY: Final = HERE + "ofCategory"
BELIEF: Final = HERE + "belief"
SCENE_BELIEF: Final = HERE + "sceneBelief"  # by the views alone
TOLD_BY: Final = HERE + "toldBy"
VIEW_COUNT: Final = HERE + "viewCount"
VIEWED_SHARE: Final = HERE + "viewedShare"
CLOSELY_VIEWED_SHARE: Final = HERE + "closelyViewedShare"
LAST_VIEWED: Final = HERE + "lastViewed"

# observations
EXPLAINED_BY: Final = HERE + "explainedBy"
FRAME: Final = HERE + "frame"
BOX: Final = HERE + "box"
SCORE: Final = HERE + "score"
MODEL: Final = HERE + "model"

# assertions of people, and the perceived values beside them (graph:assertions)
ASSERTION: Final = HERE + "Assertion"
ASSERTED_OF: Final = HERE + "assertedOf"
ASSERTED_PROPERTY: Final = HERE + "assertedProperty"
#: what people assert: of objects, of places, and a name, which a category or label keeps
ObjectProperty = Literal["category", "position", "extent", "existence", "label", "on", "inside"]
PlaceProperty = Literal["category", "label", "area", "note"]
AssertedProperty = Literal[ObjectProperty, PlaceProperty, "name"]
ASSERTED_VALUE: Final = HERE + "assertedValue"
PERCEIVED_VALUE: Final = HERE + "perceivedValue"
PERCEIVED_STRENGTH: Final = HERE + "perceivedStrength"
PERCEIVED_BELIEF: Final = HERE + "perceivedBelief"
CONFLICT_SINCE: Final = HERE + "conflictSince"

# searches by a robot: targets, looks, results (graph:map)
SEARCH: Final = HERE + "Search"
LOOK: Final = HERE + "Look"
OBSTACLE: Final = HERE + "Obstacle"
PART_OF_SEARCH: Final = HERE + "partOfSearch"
SEARCHED_FOR: Final = HERE + "searchedFor"  # a category
SEARCH_WORDS: Final = HERE + "searchWords"  # as given
SEARCH_STATE: Final = HERE + "searchState"
SEARCH_SECONDS: Final = HERE + "searchSeconds"
PROBABILITY_LEFT: Final = HERE + "probabilityLeft"
FOUND: Final = HERE + "found"
NUMBER: Final = HERE + "number"
EXTENT: Final = HERE + "extent"
GLIMPSES: Final = HERE + "glimpses"
REASON: Final = HERE + "reason"

# the floor by depth frames (graph:map)
FLOOR_TILE: Final = HERE + "FloorTile"
STOREY: Final = HERE + "storey"
CELL_SIZE: Final = HERE + "cellSize"
FLOOR_CELLS: Final = HERE + "floorCells"
VIEW_TIMES: Final = HERE + "viewTimes"

# the map itself and its recordings (graph:dataset)
NEXT_OBJECT: Final = HERE + "nextObject"
SEQUENCE: Final = HERE + "sequence"  # of the last transaction; stated of graph:dataset
FRAMES_APPLIED: Final = HERE + "framesApplied"
LAST_FRAME: Final = HERE + "lastFrame"
COORDINATE_FRAME: Final = HERE + "coordinateFrame"  # of a map; here:frame is an image
RELATIVE_TO: Final = HERE + "relativeTo"  # from frame to frame, by here:transform
TRANSFORM: Final = HERE + "transform"
FROM_RECORDING: Final = HERE + "fromRecording"
SCENE_MODEL: Final = HERE + "sceneModel"
POSE_ESTIMATE: Final = HERE + "poseEstimate"
DETECTS: Final = HERE + "detects"

# borrowed terms
RDF_TYPE: Final = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
RDFS_LABEL: Final = "http://www.w3.org/2000/01/rdf-schema#label"
RDFS_DEFINED_BY: Final = "http://www.w3.org/2000/01/rdf-schema#isDefinedBy"
RDFS_COMMENT: Final = "http://www.w3.org/2000/01/rdf-schema#comment"
RDFS_SUB_CLASS_OF: Final = "http://www.w3.org/2000/01/rdf-schema#subClassOf"
OWL_CLASS: Final = "http://www.w3.org/2002/07/owl#Class"
SKOS_ALT_LABEL: Final = "http://www.w3.org/2004/02/skos/core#altLabel"
SKOS_HIDDEN_LABEL: Final = "http://www.w3.org/2004/02/skos/core#hiddenLabel"
DCT_SOURCE: Final = "http://purl.org/dc/terms/source"
DCT_HAS_PART: Final = "http://purl.org/dc/terms/hasPart"
DCT_TITLE: Final = "http://purl.org/dc/terms/title"
DCT_CREATED: Final = "http://purl.org/dc/terms/created"
VOID_DATASET: Final = "http://rdfs.org/ns/void#Dataset"
SOSA_OBSERVATION: Final = "http://www.w3.org/ns/sosa/Observation"
SOSA_FEATURE: Final = "http://www.w3.org/ns/sosa/hasFeatureOfInterest"
SOSA_RESULT_TIME: Final = "http://www.w3.org/ns/sosa/resultTime"
BOT_SPACE: Final = "https://w3id.org/bot#Space"
BOT_INTERFACE_OF: Final = "https://w3id.org/bot#interfaceOf"
BOT_ADJACENT_ZONE: Final = "https://w3id.org/bot#adjacentZone"
GEO_HAS_GEOMETRY: Final = "http://www.opengis.net/ont/geosparql#hasGeometry"
GEO_HAS_BOUNDING_BOX: Final = "http://www.opengis.net/ont/geosparql#hasBoundingBox"
GEO_AS_WKT: Final = "http://www.opengis.net/ont/geosparql#asWKT"
PROV_AGENT: Final = "http://www.w3.org/ns/prov#Agent"
PROV_ATTRIBUTED_TO: Final = "http://www.w3.org/ns/prov#wasAttributedTo"
PROV_GENERATED_AT: Final = "http://www.w3.org/ns/prov#generatedAtTime"
XSD: Final = "http://www.w3.org/2001/XMLSchema#"
GEO_FEATURE: Final = "http://www.opengis.net/ont/geosparql#Feature"
GEO_GEOMETRY: Final = "http://www.opengis.net/ont/geosparql#Geometry"
GEOF_SF_WITHIN: Final = "http://www.opengis.net/def/function/geosparql/sfWithin"
GEO_WKT_LITERAL: Final = NamedNode("http://www.opengis.net/ont/geosparql#wktLiteral")
MATH_SQRT: Final = "http://www.w3.org/2005/xpath-functions/math#sqrt"
XSD_DOUBLE: Final = NamedNode(XSD + "double")
XSD_BASE64: Final = NamedNode(XSD + "base64Binary")
XSD_HEX: Final = NamedNode(XSD + "hexBinary")
OWL_THING: Final = "http://www.w3.org/2002/07/owl#Thing"
OWL_VERSION_INFO: Final = "http://www.w3.org/2002/07/owl#versionInfo"
OWL_NAMED_INDIVIDUAL: Final = "http://www.w3.org/2002/07/owl#NamedIndividual"
RDFS_SEE_ALSO: Final = "http://www.w3.org/2000/01/rdf-schema#seeAlso"
OWL_ONTOLOGY: Final = "http://www.w3.org/2002/07/owl#Ontology"
OWL_MEMBERS: Final = "http://www.w3.org/2002/07/owl#members"
OWL_ON_PROPERTY: Final = "http://www.w3.org/2002/07/owl#onProperty"
OWL_IMPORTS: Final = "http://www.w3.org/2002/07/owl#imports"
OWL_OBJECT_PROPERTY: Final = "http://www.w3.org/2002/07/owl#ObjectProperty"
OWL_DATATYPE_PROPERTY: Final = "http://www.w3.org/2002/07/owl#DatatypeProperty"
OWL_ANNOTATION_PROPERTY: Final = "http://www.w3.org/2002/07/owl#AnnotationProperty"
OWL_AXIOM: Final = "http://www.w3.org/2002/07/owl#Axiom"
OWL_NOTHING: Final = "http://www.w3.org/2002/07/owl#Nothing"
OWL_EQUIVALENT_CLASS: Final = "http://www.w3.org/2002/07/owl#equivalentClass"
OWL_INVERSE_OF: Final = "http://www.w3.org/2002/07/owl#inverseOf"
OWL_DISJOINT_WITH: Final = "http://www.w3.org/2002/07/owl#disjointWith"
RDFS_DATATYPE: Final = "http://www.w3.org/2000/01/rdf-schema#Datatype"
RDFS_DOMAIN: Final = "http://www.w3.org/2000/01/rdf-schema#domain"
RDFS_RANGE: Final = "http://www.w3.org/2000/01/rdf-schema#range"
SCHEMA_DOMAIN_INCLUDES: Final = "https://schema.org/domainIncludes"  # nothing follows from it
SCHEMA_RANGE_INCLUDES: Final = "https://schema.org/rangeIncludes"
OWL_ANNOTATED_SOURCE: Final = "http://www.w3.org/2002/07/owl#annotatedSource"
OWL_ANNOTATED_PROPERTY: Final = "http://www.w3.org/2002/07/owl#annotatedProperty"
OWL_ANNOTATED_TARGET: Final = "http://www.w3.org/2002/07/owl#annotatedTarget"
SH_RESULT: Final = "http://www.w3.org/ns/shacl#ValidationResult"
SH_DETAIL: Final = "http://www.w3.org/ns/shacl#detail"
SH_FOCUS_NODE: Final = "http://www.w3.org/ns/shacl#focusNode"
SH_RESULT_PATH: Final = "http://www.w3.org/ns/shacl#resultPath"
SH_RESULT_MESSAGE: Final = "http://www.w3.org/ns/shacl#resultMessage"
SH_RESULT_SEVERITY: Final = "http://www.w3.org/ns/shacl#resultSeverity"
SH_VALUE: Final = "http://www.w3.org/ns/shacl#value"
SH_WARNING: Final = "http://www.w3.org/ns/shacl#Warning"
RDF_FIRST: Final = "http://www.w3.org/1999/02/22-rdf-syntax-ns#first"
RDF_REST: Final = "http://www.w3.org/1999/02/22-rdf-syntax-ns#rest"
RDF_STATEMENT: Final = "http://www.w3.org/1999/02/22-rdf-syntax-ns#Statement"
RDF_SUBJECT: Final = "http://www.w3.org/1999/02/22-rdf-syntax-ns#subject"
RDF_PREDICATE: Final = "http://www.w3.org/1999/02/22-rdf-syntax-ns#predicate"
RDF_OBJECT: Final = "http://www.w3.org/1999/02/22-rdf-syntax-ns#object"
PROV: Final = "http://www.w3.org/ns/prov#"
PROV_ENTITY: Final = PROV + "Entity"
PROV_ACTIVITY: Final = PROV + "Activity"
PROV_PLAN: Final = PROV + "Plan"
PROV_GENERATED_BY: Final = PROV + "wasGeneratedBy"
PROV_INVALIDATED_BY: Final = PROV + "wasInvalidatedBy"
PROV_DERIVED_FROM: Final = PROV + "wasDerivedFrom"
PROV_PRIMARY_SOURCE: Final = PROV + "hadPrimarySource"
PROV_ASSOCIATED_WITH: Final = PROV + "wasAssociatedWith"
PROV_INFLUENCED_BY: Final = PROV + "wasInfluencedBy"
PROV_STARTED_AT: Final = PROV + "startedAtTime"
PROV_ENDED_AT: Final = PROV + "endedAtTime"
SOSA_MADE_BY_SENSOR: Final = "http://www.w3.org/ns/sosa/madeBySensor"
SOSA_SENSOR: Final = "http://www.w3.org/ns/sosa/Sensor"
SOSA_OBSERVES: Final = "http://www.w3.org/ns/sosa/observes"
SOSA_OBSERVED_PROPERTY: Final = "http://www.w3.org/ns/sosa/observedProperty"
SOSA_OBSERVABLE_PROPERTY: Final = "http://www.w3.org/ns/sosa/ObservableProperty"
SOSA_SIMPLE_RESULT: Final = "http://www.w3.org/ns/sosa/hasSimpleResult"
SOSA_PHENOMENON_TIME: Final = "http://www.w3.org/ns/sosa/phenomenonTime"
TIME_INSTANT: Final = "http://www.w3.org/2006/time#Instant"
TIME_IN_STAMP: Final = "http://www.w3.org/2006/time#inXSDDateTimeStamp"
PROV_QUALIFIED_ASSOCIATION: Final = PROV + "qualifiedAssociation"
PROV_ASSOCIATION: Final = PROV + "Association"
PROV_HAS_AGENT: Final = PROV + "agent"
PROV_SOFTWARE_AGENT: Final = PROV + "SoftwareAgent"
DCT_LICENSE: Final = "http://purl.org/dc/terms/license"
CONCEPTNET: Final = "https://conceptnet.io"  # + the URI of an assertion or a concept
CONCEPTNET_ONTOLOGY: Final = "https://w3id.org/hereabouts/ontology/conceptnet"
OBJECTS_ONTOLOGY: Final = "https://w3id.org/hereabouts/ontology/objects"
PLACES_ONTOLOGY: Final = "https://w3id.org/hereabouts/ontology/places"
LICENSES: Final = "https://creativecommons.org/licenses/"
SD_NAMED_GRAPH: Final = "http://www.w3.org/ns/sparql-service-description#NamedGraph"
VOID_TRIPLES: Final = "http://rdfs.org/ns/void#triples"
VOID_ENTITIES: Final = "http://rdfs.org/ns/void#entities"
VOID_CLASS: Final = "http://rdfs.org/ns/void#class"
VOID_CLASS_PARTITION: Final = "http://rdfs.org/ns/void#classPartition"

#: Prefixes that queries may use undeclared and that exports declare.
PREFIXES: Final[dict[str, str]] = {
    "here": HERE,
    "graph": GRAPH,
    "rdf": "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "rdfs": "http://www.w3.org/2000/01/rdf-schema#",
    "owl": "http://www.w3.org/2002/07/owl#",
    "xsd": XSD,
    "skos": "http://www.w3.org/2004/02/skos/core#",
    "dct": "http://purl.org/dc/terms/",
    "void": "http://rdfs.org/ns/void#",
    "sosa": "http://www.w3.org/ns/sosa/",
    "prov": PROV,
    "geo": "http://www.opengis.net/ont/geosparql#",
    "geof": "http://www.opengis.net/def/function/geosparql/",
    "bot": "https://w3id.org/bot#",
}

#: Every term of this module, by IRI.
TERMS: Final = frozenset(
    str(getattr(value, "value", value))
    for name, value in tuple(globals().items())
    if name.isupper() and isinstance(value, str | NamedNode)
)


def curie(iri: str) -> str:
    """The IRI with one of the prefixes (``here:Cup``), or in angle brackets."""
    for prefix, namespace in PREFIXES.items():
        local = iri.removeprefix(namespace)
        if local != iri and "/" not in local and "#" not in local:
            return f"{prefix}:{local}"
    return f"<{iri}>"


def local_name(iri: str) -> str:
    """Local name of an IRI: the text after its last ``#``, ``/`` or ``:``."""
    return re.split("[#/:]", iri)[-1]


def shorten(iri: str) -> str:
    """An IRI as people read it: ``here:Chair``, ``object/17``; other text unchanged.

    >>> shorten("https://w3id.org/hereabouts#Chair")
    'here:Chair'
    """
    if not iri.startswith(("http://", "https://", "urn:")):
        return iri
    for prefix, namespace in PREFIXES.items():
        if iri.startswith(namespace) and namespace not in (HERE, GRAPH):
            return f"{prefix}:{iri[len(namespace) :]}"
    if iri.startswith(HERE):
        return f"here:{iri[len(HERE) :]}"
    if iri.startswith(GRAPH):
        return f"graph:{iri[len(GRAPH) :]}"
    parts = iri.split("/")
    for kind in ("object", "place", "observation", "recording", "search"):
        if kind in parts:
            return "/".join(parts[parts.index(kind) :])
    return iri
