"""Scene classifiers over frames that are read several times: each frame goes through once."""

from __future__ import annotations

from perception.frames import Frame, SceneClassifier, SceneScores


class RememberingSceneClassifier:
    """Scene classifier that keeps the scores of each frame of one recording, by the frame's id."""

    def __init__(self, classifier: SceneClassifier) -> None:
        self._classifier = classifier
        self._known: dict[str, SceneScores] = {}

    @property
    def name(self) -> str:
        """Name of the classifier behind it."""
        return self._classifier.name

    def classify(self, frame: Frame) -> SceneScores:
        """Scores of `frame`, from the network where it is new."""
        if frame.id not in self._known:
            self._known[frame.id] = self._classifier.classify(frame)
        return self._known[frame.id]
