"""Messages as any source may deliver them: plain objects with the fields of ROS."""

from types import SimpleNamespace as Message

import numpy as np


def header(stamp: float = 0.0, frame: str = "camera") -> Message:
    nanoseconds = round(stamp * 1e9)
    time = Message(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
    return Message(stamp=time, frame_id=frame)


def image(array: np.ndarray, encoding: str, *, padding: int = 0, big: bool = False) -> Message:
    height, width = array.shape[:2]
    stored = np.ascontiguousarray(array, array.dtype.newbyteorder(">" if big else "<"))
    rows = stored.view(np.uint8).reshape(height, -1)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    return Message(
        header=header(),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=int(big),
        step=rows.shape[1],
        data=rows.tobytes(),
    )


def transform(parent, child, stamp, t=(0.0, 0.0, 0.0), q=(0.0, 0.0, 0.0, 1.0)):
    return Message(
        header=header(stamp, parent),
        child_frame_id=child,
        transform=Message(
            translation=Message(**dict(zip("xyz", t, strict=True))),
            rotation=Message(**dict(zip("xyzw", q, strict=True))),
        ),
    )


def camera_info(**changes: object) -> Message:
    fields: dict[str, object] = {
        "header": header(),
        "height": 480,
        "width": 640,
        "distortion_model": "plumb_bob",
        "d": np.zeros(5),
        "k": np.array([500.0, 0, 320, 0, 510, 240, 0, 0, 1]),
        "p": np.array([400.0, 0, 310, 0, 0, 410, 230, 0, 0, 0, 1, 0]),
        "roi": Message(x_offset=0, y_offset=0, width=0, height=0, do_rectify=False),
    }
    return Message(**(fields | changes))
