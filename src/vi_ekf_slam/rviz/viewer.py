"""A real rviz that answers questions: its displays' statuses, its clock, a picture of its view.

Runs as a process of its own under an X server (python3 -m vi_ekf_slam.rviz.viewer CONFIG WIDTH HEIGHT) and talks in
lines of JSON: a request {"do": NAME, ...} on standard input, its answer on standard output; the first line that it
writes says that it is ready. What rviz itself prints goes to standard error.
"""

import copy
import json
import os
import sys

import rospy
from nav_msgs.msg import Path
from python_qt_binding.QtCore import QSocketNotifier, Qt, QTimer
from python_qt_binding.QtGui import QColor
from python_qt_binding.QtWidgets import QApplication, QDockWidget, QToolBar, QWidget
from rviz import bindings
from sensor_msgs.msg import Image

from vi_ekf_slam.rviz.config import LENGTHS, displays_of, load_config, set_scale, topic_displays

# Of rviz, the colours by which it shows how bad a status is.
WARNING = QColor(192, 128, 0)
STATUS_WORDS = ("Ok", "Warn", "Error")
MARGIN = 0.08  # of the paths' extent, on each side
MIN_EXTENT = 2.0  # m
IMAGE_SHARE = 0.25  # of the view's width, for an image
LABEL_PX = 14.0  # height of the names of frames
LABEL_HEIGHT = 0.1  # m of a frame's name for each unit of TF's Marker Scale, as rviz draws it
CAR_SCALE = LABEL_PX / (LABEL_HEIGHT * 12.0)  # px/m at which the shipped configuration's names have that height


class Viewer:
    """rviz's window without its panels, so that the view has exactly the size that was asked for (pixels).

    Images, which have windows of their own in rviz, lie in its lower left corner.
    """

    def __init__(self, config, width, height):
        self.frame = bindings.VisualizationFrame()
        self.frame.setSplashPath("")
        self.frame.initialize()
        reader, loaded = bindings.YamlConfigReader(), bindings.Config()
        reader.readFile(loaded, config)
        if reader.error():
            raise RuntimeError("%s: %s" % (config, reader.errorMessage()))
        self.frame.load(loaded)
        self.manager = self.frame.getManager()
        self.config = load_config(config)
        displays = topic_displays(self.config)
        images = {display.name: display.topic for display in displays if display.kind == "sensor_msgs/Image"}
        self.windows = {}  # topic: the window of its image
        for dock in self.frame.findChildren(QDockWidget):
            if dock.windowTitle() in images:
                self.windows[images[dock.windowTitle()]] = dock
                dock.setTitleBarWidget(QWidget())
                dock.setFloating(True)
            else:
                dock.hide()
        for bar in self.frame.findChildren(QToolBar):
            bar.hide()
        self.frame.menuBar().hide()
        self.frame.statusBar().hide()
        self.frame.setHideButtonVisibility(False)
        self.panel = next(widget for widget in self.frame.findChildren(QWidget)
                          if widget.metaObject().className() == "rviz::RenderPanel")
        self.panel.setFixedSize(width, height)
        self.frame.show()
        self.frame.adjustSize()
        self.frame.move(0, 0)
        self.paths = {}  # topic: its last message
        rospy.init_node("rviz_paths", anonymous=True, disable_signals=True, disable_rosout=True)
        self.shapes = {}  # topic: height over width of its last image
        self.listeners = [rospy.Subscriber(display.topic, Path, self.on_path, display.topic)
                          for display in displays if display.kind == "nav_msgs/Path"]
        self.listeners += [rospy.Subscriber(topic, Image, self.on_image, topic) for topic in self.windows]

    def on_path(self, message, topic):
        """A path to be kept in view."""
        self.paths[topic] = message

    def on_image(self, message, topic):
        """An image whose window is to have its shape."""
        if message.width > 0:
            self.shapes[topic] = message.height / message.width

    def place_images(self):
        """Lay the windows of images over the view, side by side from its lower left corner."""
        corner, width = self.panel.mapToGlobal(self.panel.rect().bottomLeft()), int(IMAGE_SHARE * self.panel.width())
        for i, (topic, window) in enumerate(self.windows.items()):
            height = min(int(self.shapes.get(topic, 1.0) * width), self.panel.height())
            window.setGeometry(corner.x() + i * width, corner.y() + 1 - height, width, height)
            window.raise_()

    def statuses(self):
        """[{display, class, level, messages}] of all displays that are switched on; level is one of STATUS_WORDS."""
        root = self.manager.getRootDisplayGroup()
        return [_status(root, "Global Options")] + _group_statuses(root)

    def fit(self):
        """View from straight above with all paths of the fixed frame in it. Returns centre (m) and scale (px/m)."""
        points = [(p.pose.position.x, p.pose.position.y) for path in list(self.paths.values()) for p in path.poses
                  if path.header.frame_id == self.manager.getFixedFrame()] or [(0.0, 0.0)]
        low, high = [[f(axis) for axis in zip(*points)] for f in (min, max)]
        x, y = [0.5 * (a + b) for a, b in zip(low, high)]
        extent = [max(b - a, MIN_EXTENT) * (1.0 + 2.0 * MARGIN) for a, b in zip(low, high)]
        scale = min(self.panel.width() / extent[0], self.panel.height() / extent[1])
        self.look_down(x, y, scale)
        return {"x": x, "y": y, "scale": scale, "cell": self._set_scale(CAR_SCALE / scale)}

    def _set_scale(self, factor):
        """Draw all `factor` times as large as the configuration has it. Returns the size of the grid's cells (m)."""
        config, cell = copy.deepcopy(self.config), None
        set_scale(config, factor)
        root = self.manager.getRootDisplayGroup()
        for i, wanted in enumerate(displays_of(config)):
            display = root.getDisplayAt(i)
            for key in LENGTHS.get(wanted["Class"], []):
                display.subProp(key).setValue(wanted[key])
            if wanted["Class"] == "rviz/Grid":
                cell = wanted["Cell Size"]
                display.subProp("Cell Size").setValue(cell)
            if wanted["Class"] == "rviz/PointCloud2":
                display.subProp("Size (Pixels)").setValue(wanted["Size (Pixels)"])
            for name, shown in wanted.get("Namespaces", {}).items():
                display.subProp("Namespaces").subProp(name).setValue(shown)
        return cell

    def look_down(self, x, y, scale):
        """View from straight above: (x, y) in the fixed frame (m) is in the middle, `scale` pixels are a metre."""
        views = self.manager.getViewManager()
        view = views.getCurrent()
        if view.getClassId() != "rviz/TopDownOrtho":
            views.setCurrentViewControllerType("rviz/TopDownOrtho")
            view = views.getCurrent()
        view.subProp("Target Frame").setValue("<Fixed Frame>")
        for name, value in (("X", x), ("Y", y), ("Angle", 0.0), ("Scale", scale)):
            view.subProp(name).setValue(value)

    def grab(self, path):
        """Write the view as a PNG."""
        corner = self.panel.mapToGlobal(self.panel.rect().topLeft())
        # Of the screen, so that what lies over the view is in it.
        picture = QApplication.primaryScreen().grabWindow(0, corner.x(), corner.y(), self.panel.width(), self.panel.height())
        if picture.isNull() or not picture.save(path, "PNG"):
            raise RuntimeError("%s: the picture cannot be written" % path)

    def answer(self, request):
        """The answer to one request."""
        action = request["do"]
        self.place_images()
        if action == "time":
            return {"time": self.manager.getROSTime(), "frames": self.manager.getFrameCount()}
        if action == "status":
            return {"displays": self.statuses()}
        if action == "fit":
            return self.fit()
        if action == "grab":
            self.grab(request["path"])
            return {}
        raise RuntimeError("no request is called '%s'" % action)


def _group_statuses(group):
    found = []
    for i in range(group.numDisplays()):
        display = group.getDisplayAt(i)
        if not display.isEnabled():
            continue
        found.append(_status(display, display.getName()))
        inner = group.getGroupAt(i)
        if inner is not None:
            found += _group_statuses(inner)
    return found


def _status(display, name):
    """The status list is a child whose name ends in its level; its children are a name, a text and a colour."""
    entry = {"display": name, "class": display.getClassId(), "level": "Ok", "messages": []}
    if display.metaObject().className() == "rviz::FailedDisplay":
        return dict(entry, level="Error", messages=[display.getDescription()])
    for i in range(display.numChildren()):
        status = display.childAt(i)
        if status is None or status.metaObject().className() != "rviz::StatusList":
            continue
        entry["level"] = status.getName().rsplit(" ", 1)[-1]
        lines = [status.childAt(j) for j in range(status.numChildren())]
        entry["messages"] = ["%s: %s" % (line.getName(), line.getValue()) for line in lines
                             if entry["level"] == "Ok" or _is_bad(line)]
    if entry["level"] not in STATUS_WORDS:
        raise RuntimeError("display %s has the status '%s'" % (name, entry["level"]))
    return entry


def _is_bad(line):
    colour = line.getViewData(0, Qt.ForegroundRole)
    return isinstance(colour, QColor) and colour.red() >= WARNING.red() and colour.green() <= WARNING.green()


def main(argv):
    """Entry point of the process."""
    config, width, height = argv[0], int(argv[1]), int(argv[2])
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    application = QApplication(["rviz"])
    viewer = Viewer(config, width, height)

    def say(answer):
        answers.write(json.dumps(answer) + "\n")
        answers.flush()

    def on_input():
        line = sys.stdin.readline()
        if not line:
            application.quit()
            return
        try:
            say(viewer.answer(json.loads(line)))
        except RuntimeError as error:
            say({"error": str(error)})

    def on_start():
        if viewer.manager.getFrameCount() < 3:
            return
        timer.stop()
        say({"ready": True})

    timer = QTimer()
    timer.timeout.connect(on_start)
    timer.start(50)
    notifier = QSocketNotifier(sys.stdin.fileno(), QSocketNotifier.Read)
    notifier.activated.connect(on_input)
    application.exec_()
    os._exit(0)  # rviz's destructors and Python's do not agree on an order


if __name__ == "__main__":
    main(sys.argv[1:])
