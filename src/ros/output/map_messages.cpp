#include "vi_ekf_slam/ros/output/map_messages.hpp"

#include <sensor_msgs/point_cloud2_iterator.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {

using conversions::toPoint;

namespace {

constexpr const char* kNamespace = "landmarks";
constexpr const char* kLoops = "loop_closures";
/// Of a loop's line, width to extent of the path: 4 px where 800 show all of it, in a room as on a road.
constexpr double kLoopShare = 0.005;
constexpr double kThinnestLoop = 1e-3, kWidestLoop = 0.3; // m; rviz warns of a width of 0

visualization_msgs::Marker emptyMarker(const std::string& frame, Stamp stamp, int id) {
  visualization_msgs::Marker marker;
  marker.header = conversions::toHeader(stamp, frame);
  marker.ns = kNamespace;
  marker.id = id;
  marker.pose.orientation.w = 1.0;
  return marker;
}

constexpr double kMarkerSize = 0.2;     // m, edge of its square
constexpr double kSmallestSigma = 1e-3; // m, shown; the logarithm of 0 is none

/// Standard deviations (m) at the ends of the landmarks' colours, green and red; between them the scale is
/// logarithmic, 1 m in its middle. 96 % of the landmarks of two recorded drives (0027, 0034) are between 0.2
/// and 12 m.
constexpr double kSigmaGreen = 0.1;
constexpr double kSigmaRed = 10.0;

/// Green (kSigmaGreen and less) to red (kSigmaRed and more) by the logarithm of sigma (m).
std_msgs::ColorRGBA colour(double sigma) {
  const double decades = std::log10(std::max(sigma, kSmallestSigma) / kSigmaGreen);
  const auto share = static_cast<float>(std::clamp(decades / std::log10(kSigmaRed / kSigmaGreen), 0.0, 1.0));
  std_msgs::ColorRGBA c;
  c.r = share;
  c.g = 1.0F - share;
  c.a = 1.0F;
  return c;
}

/// Root mean square of the three standard deviations, m.
double landmarkSigma(const LandmarkEstimate& landmark) {
  return std::sqrt(std::max(0.0, landmark.covariance.trace() / 3.0));
}

/// m, the longest side of the box about the path.
double extent(const PathEstimate& path) {
  Eigen::AlignedBox3d box;
  for (const PathNode& node : path.nodes) box.extend(node.now.translation());
  return box.isEmpty() ? 0.0 : box.sizes().maxCoeff();
}

} // namespace

visualization_msgs::MarkerArray toMarkers(const std::vector<LandmarkEstimate>& landmarks, Stamp stamp,
                                          const std::string& frame, std::size_t previous_markers) {
  visualization_msgs::MarkerArray array;
  for (std::size_t begin = 0; begin < landmarks.size(); begin += kMaxPointsPerMarker) {
    auto marker = emptyMarker(frame, stamp, static_cast<int>(array.markers.size()));
    marker.type = visualization_msgs::Marker::POINTS;
    marker.action = visualization_msgs::Marker::ADD;
    marker.scale.x = marker.scale.y = kMarkerSize;
    marker.color.a = 1.0F;
    const std::size_t end = std::min(landmarks.size(), begin + kMaxPointsPerMarker);
    for (std::size_t i = begin; i < end; ++i) {
      marker.points.push_back(toPoint(landmarks[i].position));
      marker.colors.push_back(colour(landmarkSigma(landmarks[i])));
    }
    array.markers.push_back(std::move(marker));
  }
  for (std::size_t id = array.markers.size(); id < previous_markers; ++id) {
    auto marker = emptyMarker(frame, stamp, static_cast<int>(id));
    marker.action = visualization_msgs::Marker::DELETE;
    array.markers.push_back(std::move(marker));
  }
  return array;
}

visualization_msgs::Marker loopMarker(const PathEstimate& path, Stamp stamp, const std::string& frame) {
  auto marker = emptyMarker(frame, stamp, 0);
  marker.ns = kLoops;
  marker.type = visualization_msgs::Marker::LINE_LIST;
  // rviz complains about a list without points.
  marker.action = path.loops.empty() ? visualization_msgs::Marker::DELETE : visualization_msgs::Marker::ADD;
  marker.scale.x = std::clamp(kLoopShare * extent(path), kThinnestLoop, kWidestLoop);
  marker.color.r = marker.color.b = marker.color.a = 1.0F;
  const auto positionAt = [&path](Stamp end) {
    const auto node = std::lower_bound(path.nodes.begin(), path.nodes.end(), end,
                                       [](const PathNode& n, Stamp s) { return n.stamp < s; });
    return toPoint((node == path.nodes.end() ? path.nodes.back() : *node).now.translation());
  };
  for (const LoopEnds& ends : path.loops) {
    marker.points.push_back(positionAt(ends.before));
    marker.points.push_back(positionAt(ends.now));
  }
  return marker;
}

visualization_msgs::MarkerArray deleteAllMarkers(const std::string& frame) {
  auto marker = emptyMarker(frame, 0, 0);
  marker.action = visualization_msgs::Marker::DELETEALL;
  visualization_msgs::MarkerArray array;
  array.markers.push_back(marker);
  return array;
}

sensor_msgs::PointCloud2 toCloud(const std::vector<LandmarkEstimate>& landmarks, Stamp stamp,
                                 const std::string& frame) {
  using sensor_msgs::PointField;
  sensor_msgs::PointCloud2 cloud;
  cloud.header = conversions::toHeader(stamp, frame);
  cloud.height = 1;
  sensor_msgs::PointCloud2Modifier modifier(cloud);
  modifier.setPointCloud2Fields(7, "x", 1, PointField::FLOAT32, "y", 1, PointField::FLOAT32, "z", 1,
                                PointField::FLOAT32, "sigma", 1, PointField::FLOAT32, "id", 1,
                                PointField::UINT32, "id_high", 1, PointField::UINT32, "log10_sigma", 1,
                                PointField::FLOAT32);
  modifier.resize(landmarks.size());
  cloud.is_dense = true;
  sensor_msgs::PointCloud2Iterator<float> xyz(cloud, "x"), sigma(cloud, "sigma"),
      log10_sigma(cloud, "log10_sigma");
  sensor_msgs::PointCloud2Iterator<std::uint32_t> id(cloud, "id");
  for (const LandmarkEstimate& landmark : landmarks) {
    for (int axis = 0; axis < 3; ++axis) xyz[axis] = static_cast<float>(landmark.position[axis]);
    *sigma = static_cast<float>(landmarkSigma(landmark));
    *log10_sigma = std::log10(std::max(*sigma, static_cast<float>(kSmallestSigma)));
    id[0] = static_cast<std::uint32_t>(landmark.id);
    id[1] = static_cast<std::uint32_t>(landmark.id >> 32U);
    ++xyz;
    ++sigma;
    ++log10_sigma;
    ++id;
  }
  return cloud;
}

} // namespace vi_ekf_slam
