"""Recordings of other programs that are not read, and the way to files that are."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Final

from perception.sources.folders.image_files import COLOUR_SUFFIXES
from perception.sources.folders.numbered_images import COLOUR_FOLDERS

_SEEN: Final = 1000  # files of a folder that are looked at
_IMAGES: Final = ("it has images; those of colour in rgb/ and of depth (16-bit PNG, millimetres) "
                  "in depth/, numbered alike, and intrinsics.json are read")  # fmt: skip
#: names of files, in a folder or the recording itself, and advice
_FILES: Final = (
    (("*.sens",), "a recording of ScanNet; reader.py of its SensReader with --export_color_images "
     "--export_depth_images --export_poses --export_intrinsics writes a folder that is read"),
    (("*.mkv",), "a video as Azure Kinect records it; Open3D's azure_kinect_mkv_reader.py writes "
     "color/, depth/ and intrinsic.json, which are read"),
    (("*.svo", "*.svo2"), "a recording of ZED; its ROS wrapper plays it, and a bag that "
     "`ros2 bag record` makes of that is read"),
    (("*.klg", "*.oni"), "a log of ElasticFusion or a recording of OpenNI; its images as rgb/ and "
     "depth/ (16-bit PNG, millimetres) and intrinsics.json are read"),
    (("*.mcap.zst*", "*.db3.zst*", "*.bag.zst*"), "a compressed bag; `zstd -d FILE` writes one "
     "that is read"),
    (("*.zip", "*.tar", "*.tgz", "*.gz", "*.7z", "*.bz2", "*.zst", "*.xz", "*.rar"),
     "an archive; unpack it first"),
    (("EXR_RGBD",), "an export of Record3D; its .r3d file is read"),
    (("pose_intrinsic_imu.json", "matterport_color_images", "undistorted_color_images",
      "frame_*.json"), "of a recording of ScanNet++, Matterport3D or 3D Scanner App; its images as "
     "rgb/ and depth/, the 4x4 camera to world matrix of each image in pose/, and intrinsics.json "
     "are read"),
    (("lowres_wide.traj",), "of a recording of ARKitScenes; lowres_wide/, lowres_depth/ and "
     "lowres_wide_intrinsics/ beside it are read"),
    (("*.h5", "*.hdf5", "*.npz", "*.mat", "*.pkl", "*.exr", "*.ppm"), "an array, or an image of "
     "another form; its images as rgb/ (PNG or JPEG) and depth/ (16-bit PNG in millimetres, or NPY "
     "in metres), numbered alike, and intrinsics.json are read"),
    (("mav0", "cam0", "image_0"), "of a stereo recording; depth by stereo matching (16-bit PNG) in "
     "depth/ beside rgb/ would work"),
    (("sparse", "cameras.bin", "images.bin"), "of COLMAP and has no depth; with depth images in "
     "depth/, and its poses in transforms.json (nerfstudio's ns-process-data), it is read"),
    (("*.ply", "*.pcd", "*.obj", "*.glb", "*.usdz", "*.las", "*.e57"), "a model of surfaces and "
     "has no images; the colour and depth images that it was made of would work"),
    (("*.mp4", "*.mov", "*.avi", "*.webm"), "a video and has no depth; rgb.mp4 beside depth/ and "
     "intrinsics.json in a folder would work"),
)  # fmt: skip


def hint_of(path: Path) -> str:
    """A guess at a path that is no recording, with the way to map it; "" where there is none.

    Files in a folder count where the folder has no other layout.
    """
    for names, advice in _FILES:
        for name in names:
            found = [path] if path.match(name) else sorted(path.glob(name)) if path.is_dir() else []
            if found:
                return f"{found[0].name} is {advice}"
    colour = next((name for name in COLOUR_FOLDERS if (path / name).is_dir()), None)
    if colour is not None and not (path / "depth").is_dir():
        return f"it has {colour}/, but no depth/ beside it; images without depth are not mapped"
    inside = islice((one for pattern in ("*", "*/*") for one in path.glob(pattern)), _SEEN)
    images = any(one.suffix.lower() in COLOUR_SUFFIXES for one in inside)
    return _IMAGES if images else ""
