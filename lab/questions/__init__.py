"""Questions to a robot's map, with exact answers: twelve families, on simulated houses with truth.

    python -m lab.questions make --houses 601-606 -o questions
    python -m lab.questions ask questions
    python -m lab.questions score questions answers.json

`make` writes ``questions.json``, recordings of the houses, and the true maps as plain JSON; `ask`
puts the questions to maps of hereabouts through all of its interfaces; `score` scores the answers
of any other system, and `answer` answers from a plain JSON of objects and rooms.
"""
