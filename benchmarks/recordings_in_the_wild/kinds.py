"""The kinds of recordings, each with what may become of it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Final

import numpy as np
from mcap.writer import CompressionType, IndexType

from benchmarks.recordings_in_the_wild import changes as c
from benchmarks.recordings_in_the_wild import containers as to
from benchmarks.recordings_in_the_wild import image_changes as i
from benchmarks.recordings_in_the_wild.further_kinds import (
    CLOCKS_AND_TREES,
    DRIVERS,
    FOLDERS,
    MINORITIES,
)
from benchmarks.recordings_in_the_wild.kind import Kind
from benchmarks.recordings_in_the_wild.robot import (
    COLOUR,
    DEPTH,
    DEPTH_INFO,
    INFO,
    MOUNT,
    OPTICAL,
    T_BASE_BODY,
    Change,
    Messages,
    Shot,
)
from benchmarks.recordings_in_the_wild.third_parties import THIRD_PARTIES
from perception.camera.poses import Pose


def same(T: Pose) -> Pose:
    """The camera's own pose."""
    return T


def in_view_of_first(shots: Sequence[Shot]) -> Change:
    """Poses in the frame of the first camera, as visual SLAM has them."""
    first = np.linalg.inv(shots[0].T_map_cam)
    return c.other_poses(c.pose_of("/slam/pose", lambda T: first @ T))(shots)


def beside_head(shots: Sequence[Shot]) -> Change:
    """Odometry of base_link, where tf moves only a head on it."""

    def change(messages: Messages) -> Messages:
        head = c.with_links(("base_link", "camera_link", T_BASE_BODY))
        left = head(c.without("/tf")(messages))
        said = [c.odometry_of("base_link", c.base_pose)(s.stamp, s.T_map_cam) for s in shots]
        return sorted([*said, *left], key=lambda m: m.time)

    return change


OWN_CAMERA: Final = ("--intrinsics", "{folder}/intrinsics.json")

CONTAINERS: Final = (
    Kind("ROS 1 bag, rosbags", to.bag),
    Kind("ROS 1 bag, rosbag, bz2", to.rosbag("bz2")),
    Kind("ROS 1 bag, rosbag, lz4", to.rosbag("lz4")),
    Kind("ROS 1 bags split in a folder, rosbag", to.rosbag(parts=3)),
    Kind("ROS 1 .bag.active after a crash, rosbag", to.rosbag(crash=True)),
    Kind("ROS 1 bag cut short, rosbag lz4", to.cut(to.rosbag("lz4"), 0.95)),
    Kind("ROS 2 folder, SQLite", to.ros2()),
    Kind("ROS 2 folder, SQLite, zstd by message", to.ros2(compression="MESSAGE")),
    Kind("ROS 2 folder, SQLite, zstd by file", to.ros2(compression="FILE")),
    Kind("ROS 2 folder, SQLite, split", to.ros2(parts=3)),
    Kind("ROS 2 folder, SQLite, split, no metadata.yaml", to.ros2(parts=3, metadata=False)),
    Kind("ROS 2, one .db3 file", to.ros2(inner=True)),
    Kind("ROS 2 folder, MCAP, zstd", to.ros2("MCAP", "STORAGE")),
    Kind("ROS 2 folder, MCAP, split", to.ros2("MCAP", parts=3)),
    Kind("ROS 2 folder, MCAP, split, no metadata.yaml", to.ros2("MCAP", parts=3, metadata=False)),
    Kind("MCAP, mcap-ros2-support"),
    Kind("MCAP, lz4", to.mcap("ros2", "cdr", compression=CompressionType.LZ4)),
    Kind("MCAP, cdr, empty profile", to.mcap("", "cdr")),
    Kind("MCAP, ROS 1 messages", to.mcap("ros1", "ros1")),
    Kind("MCAP, no chunks", to.mcap("ros2", "cdr", use_chunking=False)),
    Kind(
        "MCAP, no index",
        to.mcap("ros2", "cdr", index_types=IndexType.NONE, use_statistics=False,
                repeat_channels=False, repeat_schemas=False),
    ),
    Kind("MCAP without end", to.cut(to.mcap("ros2", "cdr"))),
    Kind("MCAP without end, no chunks", to.cut(to.mcap("", "cdr", use_chunking=False))),
    Kind("MCAP, Foxglove's protobuf", to.mcap_protobuf),
    Kind("MCAP, Foxglove's JSON", to.mcap_json),
    Kind("MCAP, Foxglove's protobuf, JPEG", to.mcap_protobuf, (i.compressed_colour("jpeg"),)),
)  # fmt: skip

IMAGES: Final = (
    *(
        Kind(f"colour {name}", change=(i.colour(name),), colour_as_is=name != "mono8")
        for name in i.COLOURS
    ),
    Kind("colour JPEG", change=(i.compressed_colour("rgb8; jpeg compressed bgr8"),)),
    Kind("colour PNG", change=(i.compressed_colour("rgb8; png compressed bgr8"),)),
    Kind("colour 'jpg' by a driver", change=(i.compressed_colour("jpg"),)),
    Kind("depth 32FC1", change=(i.depth(i.metres, "32FC1"),)),
    Kind("depth mono16", change=(i.depth(lambda mm: mm, "mono16"),)),
    Kind("depth 16SC1", change=(i.depth(lambda mm: mm.astype(np.int16), "16SC1"),)),
    Kind("depth big-endian", change=(i.depth(i.big_endian, "16UC1", is_bigendian=1),)),
    Kind("depth with padded rows", change=(i.padded,)),
    Kind("depth compressedDepth PNG", change=(i.compressed_depth("png"),)),
    Kind("depth compressedDepth RVL", change=(i.compressed_depth("rvl"),)),
    Kind("depth compressedDepth, floats", change=(i.compressed_depth("float"),)),
    Kind(
        "depth 16UC1 in 0.25 mm",
        change=(i.depth(lambda mm: mm * np.uint16(4), "16UC1"),),
        remedy=("--depth-scale", "4000"),
        said="--depth-scale 4000",
    ),
    Kind(
        "depth 32FC1 in millimetres",
        change=(i.depth(lambda mm: mm.astype(np.float32), "32FC1"),),
        remedy=("--depth-scale", "1000000"),
        said="--depth-scale 1e",
    ),
    *(
        Kind(
            f"{count} depth images side by side of another moment",
            change=(c.of_another_moment(DEPTH, 20, 20 + count),),
            said="contradicts the frames before and after",
        )
        for count in (2, 5)
    ),
    Kind("depth of a camera beside, tf says where", change=(i.depth_apart,), holes=True),
    Kind(
        "depth of a camera beside, in colour's frame",
        change=(partial(i.depth_apart, tell=False),),
        said="not registered",
    ),
)

CAMERAS: Final = (
    Kind("CameraInfo once, latched", to.bag, (c.first_only(INFO, DEPTH_INFO),)),
    Kind("K = 0 in the first CameraInfo", change=(c.uncalibrated(INFO, DEPTH_INFO, first=2),)),
    Kind(
        "K = 0",
        change=(c.uncalibrated(INFO, DEPTH_INFO),),
        remedy=OWN_CAMERA,
    ),
    Kind(
        "K = 0 beside a P",
        change=(c.uncalibrated(INFO, DEPTH_INFO, with_p=True),),
    ),
    Kind(
        "K = 0 of colour alone",
        change=(c.uncalibrated(INFO),),
        remedy=("--info-topic", DEPTH_INFO),
        said=f"--info-topic {DEPTH_INFO}",
    ),
    Kind(
        "no CameraInfo",
        change=(c.without(INFO, DEPTH_INFO),),
        remedy=OWN_CAMERA,
    ),
    Kind(
        "CameraInfo in another namespace",
        change=(
            c.renamed(info="/calibration/front"),
            c.without(DEPTH_INFO),
            c.image_frames("", "/calibration/front"),
        ),
        remedy=("--info-topic", "/calibration/front"),
        said="--info-topic /calibration/front",
    ),
    Kind(
        "names of Azure Kinect",
        change=(c.renamed(colour="/rgb/image_raw", info="/rgb/camera_info",
                          depth="/depth_to_rgb/image_raw",
                          depth_info="/depth_to_rgb/camera_info"),),
    ),
    Kind(
        "names of OAK (depth on /oak/stereo)",
        change=(c.renamed(colour="/oak/rgb/image_rect", info="/oak/rgb/camera_info",
                          depth="/oak/stereo/image_raw", depth_info="/oak/stereo/camera_info"),),
    ),
    Kind(
        "names of ZED",
        change=(
            c.renamed(colour="/zed/zed_node/left/image_rect_color",
                      info="/zed/zed_node/left/camera_info",
                      depth="/zed/zed_node/depth/depth_registered",
                      depth_info="/zed/zed_node/depth/camera_info"),
            i.depth(i.metres, "32FC1"),
        )[::-1],
    ),
    Kind(
        "names of kinect2_bridge",
        change=(c.renamed(colour="/kinect2/qhd/image_color_rect", info="/kinect2/qhd/camera_info",
                          depth="/kinect2/qhd/image_depth_rect"), c.without(DEPTH_INFO)),
    ),
    Kind(
        "names that say nothing",
        change=(c.renamed(colour="/a", info="/b", depth="/c", depth_info="/d"),),
    ),
    Kind(
        "two cameras, one without poses and with more images",
        change=(c.second_camera("/rear", "rear_optical_frame", more=2),),
    ),
    Kind("two robots with the same frames, tf by namespace", change=(c.second_robot,)),
    Kind(
        "a camera upside down, as tf says",
        change=(c.upside_down,),
        said="turned by 180",
    ),
    Kind("leading slashes in frames", to.bag, (
        c.reframed(**{n: f"/{n}" for n in ("map", "odom", "base_link", "camera_link", OPTICAL)}),)),
    Kind(
        "no frame in the images' headers",
        change=(c.image_frames(""),),
        remedy=("--camera-frame", OPTICAL),
    ),
    Kind(
        "another frame in the images' headers",
        change=(c.image_frames("lens"),),
        remedy=("--camera-frame", OPTICAL),
    ),
    Kind(
        "images in the camera's body frame (Gazebo)",
        change=(c.image_frames("camera_link"),),
        remedy=("--pose-convention", "ros"),
        said="--pose-convention ros",
    ),
)  # fmt: skip

BODY: Final = (
    Kind("tf from odom alone", change=(c.without_link("odom"),)),
    Kind("tf begins 1.5 s late", change=(c.after(1.5, "/tf"),), said="no pose|without.* pose"),
    Kind("tf of a head on base_link, without odometry", change=(
        c.without("/tf"), c.without_link("camera_link"),
        c.with_links(("base_link", "camera_link", T_BASE_BODY))),
        remedy=("--poses", "estimate"), said="does not fit.*--poses estimate", holes=True),
    Kind("Odometry of base_link, tf_static",
         poses=c.other_poses(c.odometry_of("base_link", c.base_pose))),
    Kind("Odometry of base_link beside tf of a head", poses=beside_head),
    Kind("Odometry whose child is the camera's optical frame",
         poses=c.other_poses(c.odometry_of(OPTICAL, same), keep_static=False)),
    Kind("Odometry of an IMU that nothing links to the camera",
         poses=c.other_poses(c.odometry_of("imu", c.base_pose)),
         remedy=("--camera-in", MOUNT.replace("base_link", "imu")), said="--camera-in imu="),
    Kind("the same, without tf_static",
         poses=c.other_poses(c.odometry_of("imu", c.base_pose), keep_static=False),
         remedy=("--camera-in", MOUNT.replace("base_link", "imu")), said="--camera-in imu="),
    Kind("tf_static without base_link to the camera", change=(c.without_link("camera_link"),),
         remedy=("--camera-in", MOUNT), said="--camera-in base_link="),
    Kind("the same, mended by a URDF", change=(c.without_link("camera_link"),),
         remedy=("--camera-in", "{folder}/robot.urdf"), said="URDF"),
    Kind("Odometry without a child frame, of base_link",
         poses=c.other_poses(c.odometry_of("", c.base_pose)),
         remedy=("--pose-frame", "base_link"), said="--pose-frame base_link"),
    Kind("PoseStamped of the camera",
         poses=c.other_poses(c.pose_of("/slam/pose", same), keep_static=False)),
    Kind("PoseStamped of visual SLAM, the world as the first camera sees it",
         poses=in_view_of_first, remedy=("--up", "{1}"), said=r"--up (\S+) would"),
    Kind("PoseStamped of the camera's body, x ahead",
         poses=c.other_poses(c.pose_of("/vio/pose", c.body_pose), keep_static=False),
         remedy=("--pose-convention", "ros"), said="--pose-convention ros"),
    Kind("PoseStamped of base_link, tf_static",
         poses=c.other_poses(c.pose_of("/robot_pose", c.base_pose)),
         remedy=("--pose-frame", "base_link"), said="--pose-frame base_link"),
    Kind("PoseWithCovarianceStamped of base_link (amcl)",
         poses=c.other_poses(c.pose_of("/amcl_pose", c.base_pose, covariance=True)),
         remedy=("--pose-frame", "base_link"), said="--pose-frame base_link"),
    Kind("Path of the camera as the only poses", poses=c.path_of("/slam/path", same)),
    Kind("Path of base_link as the only poses", poses=c.path_of("/path", c.base_pose),
         remedy=("--pose-frame", "base_link"), said="--pose-frame base_link"),
    Kind("tf_static alone", change=(c.without("/tf"),), said="estimated"),
    Kind("no tf, no poses", change=(c.without("/tf", "/tf_static"),), said="estimated"),
    Kind("depth 25 ms after colour", change=(c.later(DEPTH, 25_000_000),),
         remedy=("--tolerance", "0.03"), said="--tolerance 0.03"),
    Kind("header stamps of images zero", change=(c.unstamped(COLOUR, DEPTH, INFO, DEPTH_INFO),)),
    Kind("tf by another clock, an hour off", change=(c.later("/tf", 3600 * 10**9),),
         remedy=("--poses", "{folder}/groundtruth.txt")),
    Kind("a simulation that is started again", to.bag, (c.restarted,), said="started again",
         first=24),
    Kind("no depth images", change=(c.without(DEPTH),), hopeless=True, said="no depth images"),
    Kind("no colour images", change=(c.without(COLOUR),), hopeless=True, said="no colour images"),
)  # fmt: skip

RARE: Final = (
    Kind("tf_static alone, depth of a camera beside", change=(i.depth_apart, c.without("/tf")),
         said="estimated", holes=True),
    Kind("every message twice, by two recorders", change=(c.twice,)),
    Kind("messages stored up to 0.2 s late", change=(c.shuffled,)),
    Kind("colour at half the rate of depth", change=(c.thinned(2, COLOUR, INFO),), holes=True),
    Kind("tf at a seventh of its rate", change=(c.thinned(7, "/tf"),),
         remedy=("--poses", "{folder}/groundtruth.txt")),
    Kind("CameraInfo of images half as large", change=(c.half_calibrated(INFO),)),
    Kind("depth with 65535 where nothing returns", change=(
        i.depth(lambda mm: np.where(mm == 0, np.uint16(65535), mm), "16UC1"),)),
    Kind("depth 32FC1 with infinity where nothing returns", change=(
        i.depth(lambda mm: np.where(mm == 0, np.float32(np.inf), i.metres(mm)), "32FC1"),)),
    *(Kind(f"a far plane of {far} m where nothing returns", change=(
        i.depth(lambda mm, far=far: np.where(mm == 0, np.float32(far), i.metres(mm)), "32FC1"),),
        said="no return") for far in (0.2, 8.0, 1000.0, 3.4e38)),
    Kind("frames of the images in capitals", change=(c.image_frames(OPTICAL.upper()),),
         remedy=("--camera-frame", OPTICAL)),
    Kind("every fifth colour image without pixels", change=(c.without_pixels(COLOUR),),
         said="images without pixels are left out", holes=True),
)  # fmt: skip

LIVE: Final = tuple(
    Kind(f"live from a Foxglove server, {encoding}", live=encoding)
    for encoding in ("protobuf", "json", "cdr", "ros1")
)


def kinds() -> list[Kind]:
    """All kinds."""
    bags = (*CONTAINERS, *IMAGES, *CAMERAS, *BODY, *RARE, *DRIVERS, *CLOCKS_AND_TREES)
    return [*bags, *MINORITIES, *FOLDERS, *THIRD_PARTIES, *LIVE]
