"""Camera files as the programs that write them do, all of the same cameras."""

import json

import cv2
import numpy as np

FX, FY, CX, CY = 458.5, 457.25, 367.0, 248.5
SIZE = (752, 480)
D = (-0.28, 0.07, 0.0002, 1.8e-5)
FISHEYE = (0.0034, 0.0007, -0.002, 2e-5)
XI, ALPHA = -0.17, 0.59

ROS = """image_width: 752
image_height: 480
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [458.5, 0., 367.0, 0.0, 457.25, 248.5, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.28, 0.07, 0.0002, 1.8e-5, 0.0]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix:
  rows: 3
  cols: 4
  data: [400, 0, 360, 0, 0, 400, 240, 0, 0, 0, 1, 0]
"""

ROS_ECHO = """header:
  stamp: {sec: 1, nanosec: 0}
  frame_id: cam
height: 480
width: 752
distortion_model: plumb_bob
d:
- -0.28
- 0.07
- 0.0002
- 1.8e-05
- 0.0
k:
- 458.5
- 0.0
- 367.0
- 0.0
- 457.25
- 248.5
- 0.0
- 0.0
- 1.0
"""

KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]
  distortion_model: radtan
  intrinsics: [458.5, 457.25, 367.0, 248.5]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  camera_model: pinhole
"""

KALIBR_DS = """cam0:
  camera_model: ds
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [-0.17, 0.59, 458.5, 457.25, 367.0, 248.5]
  resolution: [752, 480]
"""

EUROC = """# a camera
sensor_type: camera
T_BS: {cols: 4, rows: 4, data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.5, 457.25, 367.0, 248.5] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 1.8e-05]
"""

ORB_SLAM_2 = """%YAML:1.0
# Camera calibration and distortion parameters (OpenCV)
Camera.fx: 458.5
Camera.fy: 457.25
Camera.cx: 367.0
Camera.cy: 248.5
Camera.k1: -0.28
Camera.k2: 0.07
Camera.p1: 0.0002
Camera.p2: 1.8e-05
Camera.width: 752
Camera.height: 480
Camera.fps: 20.0
Camera.RGB: 1
Viewer.PointSize:2
"""

ORB_SLAM_3 = """%YAML:1.0
File.version: "1.0"
Camera.type: "KannalaBrandt8"
Camera1.fx: 458.5
Camera1.fy: 457.25
Camera1.cx: 367.0
Camera1.cy: 248.5
Camera1.k1: 0.0034
Camera1.k2: 0.0007
Camera1.k3: -0.002
Camera1.k4: 2.0e-5
Camera2.fx: 450
Camera2.fy: 450
Camera2.cx: 360
Camera2.cy: 240
Camera2.k1: 0
Camera2.k2: 0
Camera2.k3: 0
Camera2.k4: 0
Camera.width: 752
Camera.height: 480
Camera.newWidth: 376
"""

ORB_SLAM_STEREO = """%YAML:1.0
Camera.type: "PinHole"
Camera.fx: 435.2
Camera.fy: 435.2
Camera.cx: 367.4
Camera.cy: 252.2
Camera.k1: 0.0
Camera.k2: 0.0
Camera.p1: 0.0
Camera.p2: 0.0
Camera.bFishEye: 0
Camera.width: 752
Camera.height: 480
LEFT.height: 480
LEFT.width: 752
LEFT.D: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data:[-0.28, 0.07, 0.0002, 1.8e-05, 0.0]
LEFT.K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [458.5, 0.0, 367.0, 0.0, 457.25, 248.5, 0.0, 0.0, 1.0]
"""

COLMAP = """# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
# Number of cameras: 1
1 OPENCV 752 480 458.5 457.25 367.5 249.0 -0.28 0.07 0.0002 1.8e-05
"""

KITTI = """P0: 7.0e+02 0 600 0 0 7.0e+02 180 0 0 0 1 0
P1: 7.0e+02 0 600 -386 0 7.0e+02 180 0 0 0 1 0
P2: 7.0e+02 0 600 45 0 7.0e+02 180 -0.1 0 0 1 0.005
R0_rect: 1 0 0 0 1 0 0 0 1
R_rect 1 0 0 0 1 0 0 0 1
Tr_velo_to_cam: 1 0 0 0 0 1 0 0 0 0 1 0
Tr: 1 0 0 0 0 1 0 0 0 0 1 0
"""

KITTI_RAW = """calib_time: 09-Jan-2012 13:57:47
corner_dist: 9.950000e-02
S_00: 1392 512
K_00: 980 0 690 0 980 240 0 0 1
D_00: -0.37 0.2 0.001 0.001 -0.07
R_rect_00: 1 0 0 0 1 0 0 0 1
S_rect_00: 1242 375
P_rect_00: 700 0 600 0 0 700 180 0 0 0 1 0
"""


def transforms(**changes):
    """transforms.json of nerfstudio; a key of None is left out."""
    content = {
        "camera_model": "OPENCV", "fl_x": FX, "fl_y": FY, "cx": CX + 0.5, "cy": CY + 0.5, "w": 752, "h": 480,
        "k1": D[0], "k2": D[1], "p1": D[2], "p2": D[3],
        "frames": [{"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}], **changes,
    }  # fmt: skip
    return json.dumps({k: v for k, v in content.items() if v is not None})


def basalt(kind="ds", size=SIZE, **parameters):
    camera = {"camera_type": kind, "intrinsics": {"fx": FX, "fy": FY, "cx": CX, "cy": CY, **parameters}}
    other = {"camera_type": "eucm", "intrinsics": {}}
    return json.dumps({"value0": {"intrinsics": [camera, other], "resolution": [list(size), [9, 9]]}})


def written_by_opencv(path, fisheye=False):
    """What OpenCV's calibration program writes; YAML, XML or JSON by the file's suffix."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    file.write("calibration_time", "Tue 1 Jan")
    file.write("image_width", 752)
    file.write("image_height", 480)
    file.write("flags", 0)
    file.write("fisheye_model", int(fisheye))
    file.write("camera_matrix", np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1]]))
    file.write("distortion_coefficients", np.array([FISHEYE if fisheye else (*D, 0.0)]).T)
    file.release()
