"""Settings of the Bayes mapper's objects."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ObjectSettings:
    """Settings of `BayesObjectMapper`.

    They were chosen on three real rooms and simulated houses (`python -m benchmarks.rooms`);
    `mapping.objects.existence` has the numbers of the evidence.
    """

    min_score: float = 0.2  # detections below are ignored
    min_depth: float = 0.4  # [m] of a sighting
    max_depth: float = 5.0  # [m]

    # one thing, several boxes
    same_label_overlap: float = 0.45  # IoU above which boxes of one category are one thing
    other_label_overlap: float = 0.6  # ... of different ones
    border: float = 4.0  # [px] a box this near the image's border is cut

    # existence
    confirmed: float = 0.05  # existence that a candidate needs to enter the map
    removed: float = 0.02  # existence at which an object leaves the map
    one_of_two: float = 0.4  # share that a miss by one network of a pair counts
    forgotten: int = 300  # frames after which a candidate is dropped

    # association
    gate: float = 0.1  # [m] gate of equal categories: gate + gate_size (sizes) + gate_depth z^2
    gate_size: float = 0.12
    gate_depth: float = 0.02  # [1/m]
    stale: float = 3600.0  # [s] without a sighting after which a small thing may have been replaced
    stale_gate: float = 0.5  # share of its gate from then on
    small: float = 0.45  # [m] size of small things
    other_gate: float = 0.5  # share of the smaller size, for unequal categories
    largest: float = 1.5  # [m] sizes count no more than this
    overlap: float = 0.7  # share of the smaller footprint that makes one object of two boxes

    # extents and position
    voices: int = 25  # latest sightings that an extent is made of
    outliers: float = 0.1  # share of their sides that lie outside
    centred: float = 0.3  # [m] longer things stand at the centre of their extent
    position_noise: float = 0.05  # [m] standard deviation of a position, and ...
    size_noise: float = 0.2  # ... by the object's size
    most_weight: float = 20.0  # of earlier sightings in a position

    # merging
    separation: float = 0.6  # share of the usual width within which two of a category are one
    same_place: float = 0.2  # share of the sizes within which two never seen together are one
    interpenetration: float = 0.7  # shared footprint that two solid things cannot have

    # negative evidence
    sight_margin: float = 5.0  # [px] from the image's border
    nearest_sight: float = 0.5  # [m]
    farthest_sight: float = 4.5  # [m]
    ray_tolerance: float = 0.04  # [m] beyond half its size that a thing's surface may lie, and ...
    ray_noise: float = 0.006  # [1/m] ... more with the square of its depth
    empty: float = 0.7  # share of rays through the volume that shows it empty
    occluded: float = 0.3  # share of rays that end before it, above which nothing is known
    clear_views: int = 3  # distinct ones through its volume after which an object has left
    empty_ratio: float = 3.0  # log-likelihood ratio of such a view: absent against there

    # things that moved
    same_label: float = 0.05  # things of a category that appear for another reason, and ...
    unexplained: float = 0.12  # ... more by each thing of the category in the map
    same_size: float = 0.2  # standard deviation of log size of one thing seen twice, ...
    other_size: float = 0.4  # ... and of two things of a category
    any_size: float = 0.3  # least likelihood ratio of sizes: things are seen in parts
    short_way: float = 15.0  # [m] distances are exponential with this mean
    speed: float = 2.0  # [m/s] at which a thing is carried at most
    returned: float = 20.0  # how much more likely a thing is seen in its old spot than elsewhere
    mistaken: float = 0.02  # probability that an object that left was none, or still is there
    left: float = 0.6  # probability of absence from which on an object is looked for elsewhere
    moved: float = 0.4  # probability from which on a thing that appeared is one that left
    departures: int = 200  # things remembered that left
