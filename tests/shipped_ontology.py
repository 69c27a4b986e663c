"""The ontology of hereabouts, read once for all tests that only look at it."""

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import load_ontologies

QUADS = load_ontologies().quads
CATALOGUE = Catalogue.from_quads(QUADS)
