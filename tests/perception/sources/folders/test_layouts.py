"""Layouts of data sets, of programs and of Windows: the room written as they have it."""

import json
import shutil

import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.sources.listing import TOLERANCE
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from tests.perception.conftest import SIZE, K
from tests.perception.sources.folders.conftest import Room, line, named, rows

OPTIONS = RecordingOptions(T_map_world=np.eye(4), check=False)
TUM_OPTIONS = RecordingOptions(T_map_world=np.eye(4), check=False, depth_scale=1000)
PLAIN = "images/{n}.png", "depth/{n}.png"
CAMERA = np.eye(4)
CAMERA[:3, :3] = K
OPEN3D = json.dumps({"intrinsic_matrix": K.T.ravel().tolist()})


def scannet(room: Room) -> None:
    room.images("color/{n}.png", "depth/{n}.png").poses("pose/{n}.txt", lost=2)
    room.write("intrinsic/intrinsic_color.txt", rows(CAMERA))


def pose_files(suffix: str):
    """Depth of another kind, the camera of Open3D, and poses of one line."""

    def write(room: Room) -> None:
        room.images("images/{n}.png", f"depth/{{n}}{suffix}")
        room.poses("poses/frame{n:04d}.txt", write=line).write("intrinsics.json", OPEN3D)

    return write


def replica(room: Room) -> None:
    """Images of both in one folder, and the camera beside it."""
    room.images("results/frame{n:06d}.png", "results/depth{n:06d}.png", 6553.5)
    camera = {"w": SIZE[0], "h": SIZE[1], "fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2],
              "cy": K[1, 2], "scale": 6553.5}  # fmt: skip
    room.write("traj.txt", "".join(map(line, room.views)))
    room.write("../cam_params.json", json.dumps({"camera": camera}))


def bundle_fusion(ratio: float = 1.0, **changed: str):
    """info.txt has the cameras of both."""

    def write(room: Room) -> None:
        room.images("frame-{n:06d}.color.png", "frame-{n:06d}.depth.png")
        room.poses("frame-{n:06d}.pose.txt", lost=0)
        deep = CAMERA.copy()
        deep[:2, :2] *= ratio
        lines = {
            "m_versionNumber": "4", "m_sensorName": "StructureSensor",
            "m_colorWidth": "160", "m_colorHeight": "120", "m_depthWidth": "160",
            "m_depthHeight": "120", "m_depthShift": "1000",
            "m_calibrationColorIntrinsic": line(CAMERA).strip(),
            "m_calibrationDepthIntrinsic": line(deep).strip()}  # fmt: skip
        room.write("info.txt", "".join(f"{k} = {v}\n" for k, v in (lines | changed).items()))

    return write


def tum(room: Room, name: str = "{t}", end: str = "\n") -> None:
    """Stamps as names, and no lists."""
    room.images(f"rgb/{name}.png", "depth/{t}.png").write("K.txt", rows(K))
    room.write("groundtruth.txt", "".join(room.tum()).replace("\n", end))


def openloris(room: Room) -> None:
    """Depth as it was measured beside depth that is registered."""
    tum(room)
    (room.folder / "depth").rename(room.folder / "aligned_depth")
    room.images("color/{t}.png", "depth/{t}.png", 1.0)
    shutil.rmtree(room.folder / "rgb")


def windows(room: Room) -> None:
    tum(room, "image {t}", "\r\n")
    for kind, pattern in (("rgb", "rgb/image {t}.png"), ("depth", "depth/{t}.png")):
        lines = [f"{named('{t} ' + pattern, i)}\r\n" for i in range(6)]
        room.write(f"{kind}.txt", "\ufeff# stamp file\r\n" + "".join(lines))


def icl_nuim(room: Room) -> None:
    """Depth comes first."""
    tum(room)
    (room.folder / "groundtruth.txt").rename(room.folder / "livingRoom0.gt.freiburg")
    lines = [named("{t} depth/{t}.png {t} rgb/{t}.png\n", i) for i in range(6)]
    room.write("associations.txt", "".join(lines))


def numbered(camera: str, text: str, pose=line):
    def write(room: Room) -> None:
        room.images(*PLAIN).write(camera, text)
        room.write("poses.txt", "".join(map(pose, room.views)))

    return write


# the writer, the format, and the frame without a pose
LAYOUTS = {
    "ScanNet": (scannet, "pose-files", 2),
    "depth of NPY": (pose_files(".npy"), "pose-files", None),
    "depth of TIFF": (pose_files(".tiff"), "pose-files", None),
    "depth of PFM": (pose_files(".pfm"), "pose-files", None),
    "Replica": (replica, "replica", None),
    "BundleFusion": (bundle_fusion(), "7scenes", 0),
    "BundleFusion, two cameras": (bundle_fusion(1.1), "7scenes", 0),
    "TUM without lists": (tum, "tum", None),
    "OpenLORIS-Scene": (openloris, "tum", None),
    "lists of Windows and names with spaces": (windows, "tum", None),
    "ICL-NUIM": (icl_nuim, "tum", None),
    "camera of Open3D": (numbered("intrinsic.json", OPEN3D), "hololens", None),
    "poses of four lines": (numbered("K.txt", rows(K), rows), "hololens", None),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts_are_read_as_they_are(room, layout, caplog):
    write, kind, lost = LAYOUTS[layout]
    write(room)
    read = open_recording(room.folder, TUM_OPTIONS if kind == "tum" else OPTIONS)
    assert read.format == kind
    assert read.depth_scale == (6553.5 if kind == "replica" else 1000)
    assert (read.listing.depth_camera is None) == (layout != "BundleFusion, two cameras")
    assert ("1 of 6 images have no pose" in caplog.text) == (lost is not None)
    views = [T for i, T in enumerate(room.views) if i != lost]
    for frame, T in zip(read.frames(), views, strict=True):
        np.testing.assert_allclose(frame.T_map_cam, T, atol=1e-6)
        np.testing.assert_allclose(frame.K, K)
        assert np.nanmedian(frame.depth) > 1.0, "metres"
        assert np.isnan(frame.depth[0, 0]) or not layout.startswith("depth of")


PICKLE = np.array([{}, []], object)


@pytest.mark.parametrize(
    "content",
    [
        b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '<f4', 'fortran_order': False, 'shape': (9, 9)}",
        b"\x93NUMPY\x09\x00\x02\x00{}",
        b"\x93NUMPY",
        PICKLE,
    ],
)
def test_damaged_npy_is_said_and_pickles_are_not_loaded(room, content):
    pose_files(".npy")(room)
    for path in (room.folder / "depth").iterdir():
        if content is PICKLE:
            np.save(path, content, allow_pickle=True)
        else:
            path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"0\.npy is no NPY file of depth"):
        open_recording(room.folder, OPTIONS)


@pytest.mark.parametrize(
    ("key", "value"), [("m_depthShift", "nan"), ("m_colorWidth", ""), ("m_depthWidth", "wide")]
)
def test_malformed_info_txt_is_said(room, key, value):
    bundle_fusion(**{key: value})(room)
    with pytest.raises(RecordingError, match=rf"info\.txt.*{key}"):
        open_recording(room.folder, OPTIONS)


def test_poses_of_tum_beside_images_without_stamps_are_refused(room):
    tum(room, "{n}")
    with pytest.raises(RecordingError, match="no stamps as names"):
        open_recording(room.folder, TUM_OPTIONS)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("room.sens", "SensReader"),
        ("room.svo2", "ZED"),
        ("kinect.mkv", "azure_kinect_mkv_reader.py"),
        ("room.tar.gz", "unpack"),
        ("room.mp4", "no depth"),
        ("lowres_wide.traj", "ARKitScenes"),
    ],
)
def test_files_of_other_programs_are_named_with_the_way_to_convert_them(tmp_path, name, said):
    file = tmp_path / "recording" / name
    file.parent.mkdir()
    file.write_bytes(b"x" * 64)
    for path in (file, file.parent):
        with pytest.raises(RecordingError, match=said):
            open_recording(path)


def test_colour_without_depth_is_said(room):
    shutil.rmtree(room.images(*PLAIN).folder / "depth")
    with pytest.raises(RecordingError, match="has images/, but no depth/"):
        open_recording(room.folder)


@pytest.mark.parametrize("names", ["{}_rgb.png {}_depth.png", "RGB/{}.PNG Depth/{}.PNG"])
def test_images_in_no_known_layout_name_the_one_that_is_read(tmp_path, names):
    for name in names.format(1, 1).split():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(RecordingError, match=r"colour in rgb/ and of depth .* in depth/"):
        open_recording(tmp_path)


@pytest.mark.parametrize(("late", "count"), [(0.0, 2), (0.9 * TOLERANCE, 2), (1.1 * TOLERANCE, 1)])
def test_an_image_has_the_pose_of_its_moment_alone(room, late, count):
    """Of six images, poses of two, `late` [s]; between two poses, one is interpolated."""
    tum(room)
    lines = [line.partition(" ") for line in room.tum()[:2]]
    poses = "".join(f"{float(stamp) + late:.6f} {pose}" for stamp, _, pose in lines)
    room.write("groundtruth.txt", poses)
    assert len(open_recording(room.folder, TUM_OPTIONS)) == count
