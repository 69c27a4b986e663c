"""Further kinds: drivers, clocks, trees of frames, and folders of data sets and apps."""

from __future__ import annotations

from typing import Final

import numpy as np

from benchmarks.recordings_in_the_wild import changes as c
from benchmarks.recordings_in_the_wild import containers as to
from benchmarks.recordings_in_the_wild import folders as f
from benchmarks.recordings_in_the_wild import further_changes as d
from benchmarks.recordings_in_the_wild.kind import Kind
from benchmarks.recordings_in_the_wild.robot import (
    BEGIN,
    COLOUR,
    COMPRESSED,
    DEPTH,
    DEPTH_INFO,
    INFO,
    STATIC,
    T_BASE_BODY,
    pose,
)

DRIVERS: Final = (
    Kind("depth of half the size", change=(d.resized_depth(160, 120),), holes=True),
    Kind("depth of a wider lens at the same place, by its CameraInfo", change=(d.wider_depth(0.8),),
         holes=True, said="own CameraInfo"),
    Kind("depth at half the rate of colour", change=(c.thinned(2, DEPTH, DEPTH_INFO),), holes=True),
    Kind("CameraInfo with a region of interest", change=(d.cropped(),)),
    Kind("CameraInfo with a region of interest and binning", change=(d.cropped(binning=2),)),
    Kind("image_rect beside K and D of the raw image", change=(
        d.rectified, c.renamed(colour="/camera/color/image_rect"))),
    Kind("infrared and depth", change=(d.grey, c.renamed(
        colour="/camera/infra1/image_rect_raw", info="/camera/infra1/camera_info")),
        colour_as_is=False),
    Kind("point clouds in place of depth images", change=(
        d.only(d.POINTS, "/camera/depth/points", of=DEPTH),), hopeless=True, said="PointCloud2"),
    Kind("disparity in place of depth", to.mcap("ros2", "cdr"), (
        d.only(d.STEREO, "/stereo/disparity", of=DEPTH),), hopeless=True, said="DisparityImage"),
    Kind("pictures of depth in colours", change=(d.pictures_of_depth,), hopeless=True,
         said="no depth images"),
    Kind("colour as theora", to.mcap("ros2", "cdr"), (
        d.video("theora_image_transport/msg/Packet", "/theora"),), hopeless=True, said="video"),
    Kind("colour as FFMPEGPacket", to.mcap("ros2", "cdr"), (
        d.video("ffmpeg_image_transport_msgs/msg/FFMPEGPacket", "/ffmpeg"),), hopeless=True,
         said="video"),
    Kind("colour as foxglove_msgs/CompressedVideo", to.mcap("ros2", "cdr"), (
        d.video("foxglove_msgs/msg/CompressedVideo", "/video"),), hopeless=True, said="video"),
    Kind("colour as H.264 in CompressedImage", change=(
        d.video(COMPRESSED, "/compressed", "h264"),), hopeless=True, said="video"),
    Kind("rows of colour with step 0", change=(d.with_step(COLOUR, lambda width: 0),)),
    Kind("rows of colour with step = width", change=(d.with_step(COLOUR, lambda width: width),)),
    Kind("a detector's images beside, as many", change=(d.annotated,)),
    Kind("definitions of messages missing", to.without_definitions),
    Kind("ROS 2 folder of another storage plugin", to.other_storage, hopeless=True,
         said="zed_storage.*ros2 bag convert"),
)  # fmt: skip

CLOCKS_AND_TREES: Final = (
    Kind("images by simulated time, tf by Unix time", change=(
        d.moved_stamps(COLOUR, DEPTH, INFO, DEPTH_INFO, to=12.0),),
         remedy=("--poses", "estimate"), said="--poses estimate", holes=True),
    Kind("all by simulated time from 0", change=(d.moved_stamps(to=0.0),)),
    Kind("all by stamps that begin 3 s before zero", change=(d.moved_stamps(to=-3.0),)),
    Kind("two images of each stamp", change=(d.coarse_stamps,), holes=True),
    Kind("every fifth transform with nan", change=(d.bad_turns(
        lambda q, n: q | {"x": float("nan")} if n % 5 == 0 else q),), said="make no sense"),
    Kind("quaternions of length 0.98", change=(d.bad_turns(
        lambda q, n: {key: 0.98 * value for key, value in q.items()}),)),
    Kind("quaternions of length 0.5", change=(d.bad_turns(
        lambda q, n: {key: 0.5 * value for key, value in q.items()}),), said="length 1"),
    Kind("the first transforms all zero", change=(d.bad_turns(
        lambda q, n: dict.fromkeys("xyzw", 0.0) if n < 6 else q),), said="make no sense"),
    Kind("map -> odom that jumps each second", change=(d.corrected,), holes=True),
    Kind("map -> odom every 2 s", change=(d.of_link("odom", lambda n: n % 20 == 0),)),
    Kind("map -> odom once, on /tf", change=(d.of_link("odom", lambda n: n == 0),)),
    Kind("tf of 3000 more frames", change=(d.many_frames(3000),)),
)  # fmt: skip

_FEW: Final = range(4, 50, 10)  # frames, between those that are compared
MINORITIES: Final = (
    Kind("5 of 50 depth images in another unit", change=(d.of_frames(DEPTH, _FEW, d.times(4)),),
         holes=True, said="contradicts the frames before"),
    Kind("5 of 50 depth images 15 % too far", change=(d.of_frames(DEPTH, _FEW, d.times(1.15)),),
         holes=True, said="contradicts the frames before"),
    Kind("5 of 50 colour images of another size", change=(
        d.of_frames(COLOUR, _FEW, d.smaller),), holes=True, said="is left out"),
    Kind("5 of 50 colour images mirrored", change=(
        d.of_frames(COLOUR, _FEW, d.mirrored),), holes=True, said="does not show"),
    Kind("two mounts of the camera on /tf_static", change=(
        c.with_links(("base_link", "camera_link", T_BASE_BODY @ pose(0.3, 0, 0)), topic=STATIC),),
         said="contradict each other"),
    *(Kind(f"{name}, an image of each missing", folder=f.without(folder, *images), holes=True,
           said="left out") for name, folder, images in (
        ("pose files", f.images(pose="pose/{n:06d}.txt"), ("depth/000012.png", "rgb/000030.png")),
        ("Polycam", f.images("keyframes/images/{n:06d}.jpg", "keyframes/depth/{n:06d}.png",
                             more=f.polycam),
         ("keyframes/depth/000012.png", "keyframes/images/000030.jpg")),
        ("BundleFusion", f.images("frame-{n:06d}.color.jpg", "frame-{n:06d}.depth.png",
                                  pose="frame-{n:06d}.pose.txt", more=f.bundle_fusion),
         ("frame-000012.depth.png", "frame-000030.color.jpg")))),
    Kind("pose files, 6 of 50 depth images missing", folder=f.without(
        f.images(pose="pose/{n:06d}.txt"), *(f"depth/{n:06d}.png" for n in range(0, 36, 6))),
         hopeless=True, said="6 of 50 frames"),
    Kind("pose files that are all nan", folder=f.images(
        pose="pose/{n:06d}.txt", of_pose=lambda T: np.full_like(T, np.nan)),
         remedy=("--poses", "estimate"), said="--poses estimate", holes=True),
    *(Kind(f"TUM, stamps in {unit} since the computer was started", folder=f.tum(
        "rgb/{n:06d}.png", depth="depth/{n:06d}.png",
        stamp=lambda s, per=per: str((s.stamp - BEGIN + 86_400 * 10**9) // per)),
           said="are taken for", holes=True)
      for unit, per in (("milliseconds", 10**6), ("nanoseconds", 1))),
    Kind("pose files in millimetres, images mirrored", folder=f.images(
        of_depth=lambda s: f.MILLIMETRES(s)[:, ::-1], of_colour=lambda s: s.rgb[:, ::-1],
        pose="pose/{n:06d}.txt", of_pose=lambda T: np.vstack([T[:3] * [1, 1, 1, 1000], T[3]])),
         hopeless=True, said="millimetres and colour and depth are mirrored"),
)  # fmt: skip

FOLDERS: Final = (
    Kind("ScanNet, exported, a pose lost", folder=f.images(
        "color/{n}.jpg", "depth/{n}.png", pose="pose/{n}.txt", more=f.scannet), said="no pose"),
    Kind("Replica of NICE-SLAM", folder=f.images(
        "results/frame{n:06d}.jpg", "results/depth{n:06d}.png", f.in_units(6553.5),
        more=f.replica)),
    Kind("BundleFusion, info.txt", folder=f.images(
        "frame-{n:06d}.color.jpg", "frame-{n:06d}.depth.png", pose="frame-{n:06d}.pose.txt",
        more=f.bundle_fusion)),
    Kind("Neural RGB-D", folder=f.images("images/img{n}.png", "depth/depth{n}.png",
                                        more=f.neural_rgbd),
         remedy=("--intrinsics", "{folder}/intrinsics.json", "--pose-convention", "opengl"),
         said="--intrinsics"),
    Kind("pose files and depth in NPY, metres", folder=f.images(
        depth="depth/{n:06d}.npy", of_depth=lambda s: s.depth, pose="pose/{n:06d}.txt")),
    Kind("pose files and depth in TIFF, metres", folder=f.images(
        depth="depth/{n:06d}.tiff", of_depth=lambda s: s.depth, pose="poses/{n:06d}.txt")),
    Kind("pose files, seconds and nanoseconds as names", folder=f.images(
        "rgb/{ros}.png", "depth/{ros}.png", pose="pose/{ros}.txt")),
    Kind("pose files, 12 m with noise where nothing returns", holes=True, folder=f.images(
        depth="depth/{n:06d}.npy", of_depth=f.noise_at(12.0), pose="pose/{n:06d}.txt")),
    Kind("pose files, world to camera", folder=f.images(
        pose="pose/{n:06d}.txt", of_pose=lambda T: np.linalg.inv(T).astype(np.float64)),
         remedy=("--pose-convention", "world-to-camera"), said="--pose-convention world-to-camera"),
    Kind("depth in 8 bits", folder=f.images(
        of_depth=lambda s: np.nan_to_num(s.depth * 25).astype(np.uint8), pose="pose/{n:06d}.txt"),
         hopeless=True, said="16-bit"),
    Kind("depth in JPEG", folder=f.images(depth="depth/{n:06d}.jpg",
        of_depth=lambda s: np.nan_to_num(s.depth * 25).astype(np.uint8)),
         hopeless=True, said="16-bit"),
    Kind("colour in RGBA", folder=f.images(of_colour=lambda s: np.dstack(
        [s.rgb, np.full(s.depth.shape, 128, np.uint8)]), pose="pose/{n:06d}.txt")),
    Kind("depth of another aspect", folder=f.images(
        of_depth=f.thumbnails(f.in_units(1000), 256, 144), pose="pose/{n:06d}.txt"),
         hopeless=True, said="another aspect"),
    Kind("colour alone and poses, no depth", folder=f.images(
        depth="masks/{n:06d}.png", pose="pose/{n:06d}.txt"), hopeless=True, said="depth"),
    Kind("TUM, written under Windows", folder=f.tum(line="\r\n", begin="\ufeff# stamp file\n")),
    Kind("TUM, spaces in names", folder=f.tum("rgb/image {stamp}.png")),
    Kind("TUM, depth first in associations.txt", folder=f.tum(
        associations="{stamp} depth/{stamp}.png {stamp} rgb/{stamp}.png", lists=False)),
    Kind("ICL-NUIM, as TUM", folder=f.tum(
        associations="{stamp} depth/{stamp}.png {stamp} rgb/{stamp}.png", lists=False,
        poses="livingRoom0.gt.freiburg")),
    Kind("TUM without rgb.txt and depth.txt", folder=f.tum(lists=False)),
    Kind("nerfstudio", folder=f.nerfstudio()),
    Kind("nerfstudio, two images missing", folder=f.nerfstudio(missing=2), said="missing"),
    Kind("nerfstudio, a model of another lens", folder=f.nerfstudio(camera_model="EQUIRECTANGULAR"),
         hopeless=True, said="EQUIRECTANGULAR"),
    Kind("Polycam, depth 256 x 192", folder=f.images(
        "keyframes/images/{n:06d}.jpg", "keyframes/depth/{n:06d}.png",
        f.thumbnails(f.in_units(1000), 256, 192), more=f.polycam)),
    Kind("Open3D's reader of Azure Kinect", folder=f.images(
        "color/{n:05d}.jpg", "depth/{n:05d}.png", more=f.open3d),
         said="estimated"),
    Kind("ARKitScenes", folder=f.images(
        "lowres_wide/42_{stamp}.png", "lowres_depth/42_{stamp}.png", more=f.arkit_scenes)),
    Kind("a video beside depth images", folder=f.video, said="estimated"),
    *(Kind(f"a file {name}", folder=f.file_of(name, head), hopeless=True, said=said)
      for name, head, said in (
          ("kinect.mkv", b"\x1a\x45\xdf\xa3", "Azure Kinect"),
          ("room.sens", b"\4\0\0\0", "ScanNet"),
          ("zed.svo2", b"\x89", "ZED"), ("room.klg", b"\1", "ElasticFusion"),
          ("room.oni", b"NI10", "OpenNI"), ("room.zip", b"PK\3\4", "unpack"),
          ("room.mp4", b"\0\0\0\x18ftyp", "no depth"), ("room.ply", b"ply\n", "no images"))),
)  # fmt: skip
