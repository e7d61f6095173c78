"""Rendered images of markers at known poses."""

import numpy as np

FX, SIZE, WIDTH, HEIGHT = 600.0, 0.2, 640, 480
LENS = np.array([[FX, 0, WIDTH / 2], [0, FX, HEIGHT / 2], [0, 0, 1]])


def texture(cv2, dictionary, number):
    """Image of a marker: 400 pixels for a side of length 1, with a white margin."""
    words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
    marker = cv2.aruco.generateImageMarker(words, number, 400)
    return cv2.copyMakeBorder(marker, 100, 100, 100, 100, cv2.BORDER_CONSTANT, value=255)


def rendered(cv2, *markers, dictionary="6X6_250", lens=LENS, size=(WIDTH, HEIGHT)):
    """A rendered image of markers.

    Each marker is (number, distance over the ground in metres, degrees to the left, height in metres,
    rotation in degrees).
    """
    image = np.full((size[1], size[0]), 200, np.uint8)
    for number, distance, angle, up, turned in markers:
        picture = texture(cv2, dictionary, number)
        half = SIZE / 2 * 600 / 400
        square = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
        c, s = np.cos(np.radians(turned)), np.sin(np.radians(turned))
        square = square @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
        a = np.radians(angle)
        square += [-distance * np.sin(a), -up, distance * np.cos(a)]
        seen = square @ lens.T
        corners = (seen[:, :2] / seen[:, 2:]).astype(np.float32)
        of = np.array([[0, 0], [600, 0], [600, 600], [0, 600]], np.float32) - 0.5
        way = cv2.getPerspectiveTransform(of, corners)
        cv2.warpPerspective(
            picture, way, size, image, cv2.INTER_AREA, borderMode=cv2.BORDER_TRANSPARENT
        )
    return image
