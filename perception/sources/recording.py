"""Open a recorded sequence of RGB-D frames with poses, whatever its layout on disk."""

from __future__ import annotations

import functools
import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError, did_you_mean
from perception.camera.channel_order import MIN_VIEWS, ChannelOrder
from perception.camera.gravity_alignment import (
    clear_turns,
    gravity_aligned_transform,
    parse_up,
    read_gravity,
    side_up,
    turned_camera,
    turned_image,
    turned_poses,
)
from perception.camera.intrinsics import (
    ASPECT_TOLERANCE,
    Intrinsics,
    Rectifier,
    find_intrinsics,
    register_depth,
)
from perception.camera.poses import (
    BODY_FROM_CAMERA,
    CONVENTIONS,
    Pose,
    checked_pose,
    gridded_pose,
)
from perception.frames import Frame
from perception.no_return import Constant, without_constants
from perception.odometry.tracking_report import TrackingReport
from perception.sources.bags import bag
from perception.sources.bags.camera_mounts import mount
from perception.sources.depth_check import check_depth, depth_findings
from perception.sources.depth_values import no_return_of
from perception.sources.estimated_poses import (
    OnEstimated,
    check_height,
    wants_estimate,
    with_estimated_poses,
)
from perception.sources.folders.image_files import DisparityImage, posed
from perception.sources.formats import format_of
from perception.sources.intrinsics_check import check_intrinsics
from perception.sources.listing import DamagedImages, FrameEntry, RecordingListing
from perception.sources.recording_options import (
    DEFAULT_OPTIONS,
    RecordingOptions,
    with_trajectory,
)

_log = logging.getLogger(__name__)
LATEST = 1e11  # [s] of a stamp, in the year 5138
FIRST = 3  # frames, of which one has to be readable
SAMPLED = MIN_VIEWS  # images, spread evenly, whose size is that of most
ABSOLUTE_STAMP = 1e8  # [s] smaller stamps count from the start of the recording


@dataclass(frozen=True, slots=True)
class FolderRecording:
    """A recording in a folder or a file; frames are read from disk when asked for."""

    name: str
    format: str
    T_map_world: NDArray[np.float64]  # (4, 4)
    listing: RecordingListing
    rectifier: Rectifier
    depth_scale: float  # depth units a metre
    start_time: float  # [s] added to every stamp; 0 where stamps are absolute
    gravity_aligned: bool = False  # whether T_map_world was found from what it shows, not given
    transform_given: bool = False  # whether the caller gave T_map_world
    turns: int = 0  # quarters, counter-clockwise, that images are turned by; poses are turned too
    estimate: TrackingReport | None = None  # of poses that were estimated from the images
    no_return: tuple[Constant, ...] = ()  # depths that mean that nothing was measured
    bgr: bool = False  # whether red and blue of its images are exchanged
    damaged: DamagedImages = field(default_factory=DamagedImages)

    def placed(self, T_map_world: NDArray[np.float64]) -> FolderRecording:
        """The same recording by the transform (4, 4)."""
        return replace(self, T_map_world=T_map_world, gravity_aligned=False)

    def placed_as_given(self, T_map_world: NDArray[np.float64]) -> FolderRecording:
        """The same by the transform (4, 4) that the caller gave; raises RecordingError."""
        T = np.asarray(T_map_world, np.float64)
        checked_pose(T, "given T_map_world")
        return replace(self.placed(T), transform_given=True)

    def __len__(self) -> int:
        return len(self.listing.entries)

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """Frames from index `start` on, as of `frame`."""
        return map(self.frame, range(start, len(self)))

    def frame(self, index: int) -> Frame:
        """Frame of that index: black and without depth where an image cannot be read.

        Raises RecordingError where too many cannot.
        """
        entry = self.listing.entries[index]
        if entry.id not in self.damaged.causes:
            try:
                return self.decoded(entry)
            except RecordingError as error:
                self.damaged.add(entry.id, error)
        self.damaged.tell(entry.id)
        width, height = self.rectifier.camera.size
        blank = np.zeros((height, width, 3), np.uint8)
        return self._frame(entry, blank, np.full((height, width), np.nan, np.float32))

    def decoded(self, entry: FrameEntry) -> Frame:
        """The frame of an entry by this recording's camera; raises RecordingError."""
        camera = self.rectifier.camera
        rgb = entry.colour.colour()
        if self.bgr:
            rgb = np.ascontiguousarray(rgb[:, :, ::-1])
        if rgb.shape[1::-1] != (camera.width, camera.height):
            raise RecordingError(
                f"{entry.colour} is {rgb.shape[1]}x{rgb.shape[0]}, other images "
                f"{camera.width}x{camera.height}"
            )
        return self._frame(entry, self.rectifier.colour(rgb), self._depth(entry))

    def _frame(
        self, entry: FrameEntry, rgb: NDArray[np.uint8], depth: NDArray[np.float32]
    ) -> Frame:
        camera = self.rectifier.camera
        return Frame(
            id=entry.id,
            rgb=turned_image(rgb, self.turns),
            depth=turned_image(depth, self.turns),
            K=(turned_camera(camera, self.turns) if self.turns else camera).K,
            T_map_cam=self.T_map_world @ entry.T_world_cam,
            stamp=entry.stamp + self.start_time,
            camera=entry.camera,
        )

    def _depth(self, entry: FrameEntry) -> NDArray[np.float32]:
        depth = entry.depth.depth(self.depth_scale)
        height, width = depth.shape
        camera, apart = self.rectifier.camera, self.listing.depth_camera
        if apart is not None:
            own = _rectifier_of(apart.intrinsics.fitted(width, height))
            measured = without_constants(own.depth(depth), own.camera.K, self.no_return)
            return register_depth(
                measured, own.camera.K, camera.K, apart.T_colour_depth, camera.size
            )
        if abs(width * camera.size[1] / (height * camera.size[0]) - 1) > ASPECT_TOLERANCE:
            raise RecordingError(
                f"{entry.depth} is {width}x{height} and colour {camera.width}x{camera.height}: "
                "another aspect, so depth is not registered to colour"
            )
        rectified = self.rectifier.depth(depth)
        known = self.no_return  # those of the image alone are left to the frame
        return without_constants(rectified, camera.K, known) if known else rectified


def open_recording(
    path: Path | str,
    options: RecordingOptions = DEFAULT_OPTIONS,
    *,
    listing: RecordingListing | None = None,
    on_estimated: OnEstimated | None = None,
) -> FolderRecording:
    """Open the recording at `path`, a folder or a bag, and check all that needs no decoding.

    Where it has no poses they are estimated, which decodes all frames; `on_estimated` is called
    after each. `listing` is the recording's listing where it was read already. Raises
    RecordingError.
    """
    folder, o = Path(path), options
    chosen = format_of(folder, o.format)
    listing = listing or chosen.read(folder, o.streams)
    if listing.unused_poses and o.poses is None and not o.estimate_poses:
        raise RecordingError(listing.unused_poses)
    estimating = wants_estimate(listing, o)
    listing = _listing(listing, o, folder, estimating)
    if chosen is not bag.FORMAT:
        listing, o = _on_mount(listing, o, f"{folder} is a {chosen.name} recording", estimating)
    if max(entry.stamp for entry in listing.entries) > LATEST:
        raise RecordingError(f"{folder}: its stamps are no seconds since 1970; these would work")
    relative = max(entry.stamp for entry in listing.entries) < ABSOLUTE_STAMP
    begin = time.time() if o.start_time is None else o.start_time
    convert = _convention(o.pose_convention)
    as_read = [entry.T_world_cam for entry in listing.entries]
    entries = tuple(
        replace(entry, T_world_cam=gridded_pose(convert(T)) if np.isfinite(T).all() else T)
        for entry, T in zip(listing.entries, as_read, strict=True)
    )
    up = read_gravity(folder) if listing.up is None else listing.up
    listing = replace(listing, entries=entries, up=up)
    rectifier, order = _rectifier(listing, folder, bgr=o.bgr)
    listing = _of_disparity(listing, rectifier.camera, o.disparity)
    recording = FolderRecording(
        name=o.name or _name(folder),
        format=chosen.name,
        T_map_world=np.eye(4),
        listing=listing,
        rectifier=rectifier,
        depth_scale=_depth_scale(listing, o.depth_scale),
        start_time=begin if relative else 0.0,
        bgr=o.bgr,
        damaged=DamagedImages(o.name or _name(folder), len(entries)),
    )
    _check_images(recording)
    if o.check and order.told:
        _log.warning("%s: %s", recording.name, order.told)
    apart = listing.depth_camera
    seen_by = recording.rectifier.camera if apart is None else apart.intrinsics
    known = no_return_of(recording.name, listing, seen_by, recording.depth_scale, tell=o.check)
    recording = replace(recording, no_return=known)
    if estimating:
        return _by_estimated_poses(recording, o, on_estimated)
    if o.check:
        check_intrinsics(recording.name, [e.T_world_cam for e in entries], recording.frame)
        others = listing.other_frames if o.poses is None else {}
        scale, read = recording.depth_scale, recording.frame
        check_depth(depth_findings(recording.name, as_read, o.pose_convention, scale, read, others))
    if o.T_map_world is not None:
        return recording.placed_as_given(o.T_map_world)
    if listing.T_map_world is not None and o.up is None:
        return replace(recording, T_map_world=listing.T_map_world, gravity_aligned=True)
    given, doubted = (up, o.check) if o.up is None else (o.up, False)
    T = gravity_aligned_transform(recording, up=given, doubted=doubted and given is not None)
    if given is None:
        _warn_of_sides(recording)
    recording = _upright(recording, o)
    return replace(recording, T_map_world=T, gravity_aligned=o.up is None)


def _of_disparity(
    listing: RecordingListing, camera: Intrinsics, baseline: float | None
) -> RecordingListing:
    """The listing whose depth images are disparities of a pair of cameras; None: they are not."""
    if baseline is None:
        return listing
    seen_by = camera if listing.depth_camera is None else listing.depth_camera.intrinsics
    images = (DisparityImage(entry.depth, seen_by, baseline) for entry in listing.entries)
    pairs = zip(listing.entries, images, strict=True)
    return replace(listing, entries=tuple(replace(entry, depth=image) for entry, image in pairs))


def _check_images(recording: FolderRecording) -> None:
    """Check the head and tail of every file, and the first frames; raises RecordingError."""
    damaged = recording.damaged
    for entry in recording.listing.entries:
        try:
            entry.colour.check()
            entry.depth.check()
        except RecordingError as error:
            damaged.add(entry.id, error)
    whole = [e for e in recording.listing.entries if e.id not in damaged.causes]
    failures = dict[str, RecordingError]()
    for entry in whole[:FIRST]:
        try:
            recording.decoded(entry)
            break
        except RecordingError as error:
            failures[entry.id] = error
    else:
        raise next(iter(failures.values()))  # all alike: the camera or the layout is another
    for name, cause in failures.items():
        damaged.add(name, cause)


def _warn_of_sides(recording: FolderRecording) -> None:
    """Warn of a camera that turned as one that is held on its side, where up was only guessed."""
    side = side_up([entry.T_world_cam for entry in recording.listing.entries])
    if side is not None:
        _log.warning(
            "%s: its camera turned from side to side about an axis across its images, as one that "
            "is held on its side does; if the images lie on their side, --up=%s or --up=%s lays "
            "the map upright",
            recording.name,
            *(",".join(f"{x:.3f}" for x in sign * side) for sign in (1.0, -1.0)),
        )


def _upright(recording: FolderRecording, o: RecordingOptions) -> FolderRecording:
    """The recording with its images turned upright, where the camera is mounted otherwise."""
    listing, up = recording.listing, recording.listing.up if o.up is None else parse_up(o.up)
    turns = 0 if up is None else clear_turns([e.T_world_cam for e in listing.entries], up)
    if not turns:
        return recording
    _log.warning(
        "%s: its images are turned by %d degrees, since its poses have up at another side than "
        "their top",
        recording.name,
        90 * turns,
    )
    entries = tuple(
        replace(e, T_world_cam=gridded_pose(turned_poses(e.T_world_cam, turns)))
        for e in listing.entries
    )
    return replace(recording, listing=replace(listing, entries=entries), turns=turns)


def _by_estimated_poses(
    recording: FolderRecording, o: RecordingOptions, on_estimated: OnEstimated | None
) -> FolderRecording:
    """The recording by poses that its images give, placed as the options say."""
    name = recording.name
    listing, report = with_estimated_poses(
        recording.listing, recording.frame, o, name, on_estimated
    )
    recording = replace(recording, listing=listing, estimate=report)
    if o.T_map_world is not None:
        return recording.placed_as_given(o.T_map_world)
    T = gravity_aligned_transform(recording, up=listing.up if o.up is None else o.up)
    if o.check:
        heights = [float((T @ e.T_world_cam)[2, 3]) for e in recording.listing.entries]
        check_height(recording.name, heights, recording.depth_scale)
    return replace(recording, T_map_world=T, gravity_aligned=True)


def _listing(
    listing: RecordingListing, options: RecordingOptions, path: Path, estimating: bool
) -> RecordingListing:
    """Listing of the selected frames, with the camera and the poses that the options give."""
    selection = options.selection.reached if estimating else options.selection
    entries = listing.entries
    if options.poses is None and not estimating:
        entries = posed(entries, path)
        if listing.entries and not entries:
            why = listing.no_pose_found or f"{path}: no frame has a pose: all are not finite"
            raise RecordingError(f"{why}; --poses estimate finds poses in the images")
    entries = selection.of(entries, str(path))
    if options.poses is not None:
        entries = posed(with_trajectory(entries, options.poses), options.poses)
        if not entries:
            raise RecordingError(
                f"{options.poses} holds no finite pose; --poses estimate finds some"
            )
    camera, given = listing.camera, options.intrinsics
    if camera is None and given is None and not listing.no_camera:
        camera = find_intrinsics(path.resolve().parent)
        if camera is not None:
            _log.warning("%s: its camera is that of %s, one folder above", path, camera.source)
    if given is not None:
        # the folder's depth scale holds where the given intrinsics do not say one
        known = camera if given.depth_scale is None and camera is not None else given
        camera = replace(given, depth_scale=known.depth_scale)
    apart = None if options.registered else listing.depth_camera
    return replace(listing, entries=entries, camera=camera, depth_camera=apart)


def _on_mount(
    listing: RecordingListing, o: RecordingOptions, what: str, estimating: bool
) -> tuple[RecordingListing, RecordingOptions]:
    """A folder's listing by poses of the camera, where it has those of a body that carries it."""
    if replace(o.streams, camera_in=None).given:
        raise RecordingError(f"{what}: streams are chosen in bags and MCAP files only")
    if o.streams.camera_in is None or estimating:
        return listing, o
    convert, X = _convention(o.pose_convention), mount(o.streams.camera_in) @ BODY_FROM_CAMERA
    entries = (replace(e, T_world_cam=convert(e.T_world_cam) @ X) for e in listing.entries)
    plain = replace(o, pose_convention="camera-to-world")
    return replace(listing, entries=tuple(entries)), plain


def _name(path: Path) -> str:
    """Name of a folder, or of a file without its suffix."""
    whole = path.resolve()
    return whole.name if whole.is_dir() else whole.stem


def _convention(name: str) -> Callable[[Pose], Pose]:
    if name not in CONVENTIONS:
        raise RecordingError(
            f"unknown pose convention {name!r}; known are {', '.join(CONVENTIONS)}"
            + did_you_mean(name, CONVENTIONS)
        )
    return CONVENTIONS[name]


@functools.lru_cache(maxsize=4)
def _rectifier_of(camera: Intrinsics) -> Rectifier:
    return Rectifier.for_camera(camera)


def _rectifier(
    listing: RecordingListing, folder: Path, *, bgr: bool
) -> tuple[Rectifier, ChannelOrder]:
    """The camera fitted to the size of most of SAMPLED images, and the order of their channels."""
    if listing.camera is None:
        raise RecordingError(
            listing.no_camera
            or f"{folder} has no intrinsics: a file intrinsics.json in it with "
            '{"fx": 525, "fy": 525, "cx": 319.5, "cy": 239.5} of its colour camera [px], or '
            "--intrinsics FILE, would work"
        )
    sizes, failures, order = list[tuple[int, ...]](), list[RecordingError](), ChannelOrder()
    places = np.unique(np.linspace(0, len(listing.entries) - 1, SAMPLED).astype(int))
    for place in places.tolist():
        try:
            rgb = listing.entries[place].colour.colour()
        except RecordingError as error:
            failures.append(error)
        else:
            sizes.append(rgb.shape[1::-1])
            order.add(rgb[:, :, ::-1] if bgr else rgb)
    if not sizes:
        raise failures[0]
    width, height = max(sizes, key=sizes.count)
    return Rectifier.for_camera(listing.camera.fitted(width, height)), order


def _depth_scale(listing: RecordingListing, given: float | None) -> float:
    of_camera = listing.camera.depth_scale if listing.camera is not None else None
    scale = next(s for s in (given, of_camera, listing.depth_scale) if s is not None)
    if not (np.isfinite(scale) and scale > 0):
        raise RecordingError(f"depth scale must be a positive number of units a metre, got {scale}")
    return float(scale)
