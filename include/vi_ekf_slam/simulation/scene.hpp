#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/simulation/block_path.hpp"
#include "vi_ekf_slam/simulation/drive_options.hpp"
#include "vi_ekf_slam/simulation/random.hpp"

namespace vi_ekf_slam::simulation {

/// The stereo pair with the size of its images and the range of depths in which it sees points.
struct View {
  StereoRig rig;
  double width = 1226.0;  ///< px
  double height = 370.0;  ///< px
  double margin = 5.0;    ///< px at the border of each image that stay empty, so that noise does not leave it
  double min_depth = 3.0; ///< m
  double max_depth = 150.0; ///< m

  /// Whether a point of the left optical frame (m) projects into both images.
  bool sees(const Eigen::Vector3d& p_cam) const;
  bool contains(const StereoPixels& pixels) const;
};

/// Camera of the public drives of 2011-09-30, mounted as there and misaligned by a fraction of a degree; a
/// handheld body has a small pair 0.11 m wide.
View makeView(const DriveOptions& options);

/// A static point; `index` identifies it within its scene.
struct ScenePoint {
  std::uint64_t index = 0;
  Eigen::Vector3d world = Eigen::Vector3d::Zero(); ///< m
  std::uint64_t look = 0;                          ///< points of one number look alike
};

/// The static surroundings.
class Scene {
 public:
  virtual ~Scene() = default;
  /// Up to `count` different points that the camera at `world_T_cam` sees, nearer ones preferred; none whose
  /// index is in `taken` (sorted).
  virtual std::vector<ScenePoint> detect(const SE3& world_T_cam, std::size_t count,
                                         const std::vector<std::uint64_t>& taken) = 0;
  /// Whether something stands between the camera at `camera_world` and `point_world` (m).
  virtual bool occluded(const Eigen::Vector3d& /*camera_world*/,
                        const Eigen::Vector3d& /*point_world*/) const {
    return false;
  }
};

/// Points that stay where they are.
class PointScene : public Scene {
 public:
  std::vector<ScenePoint> detect(const SE3& world_T_cam, std::size_t count,
                                 const std::vector<std::uint64_t>& taken) override;

 protected:
  PointScene(const DriveOptions& options, const View& view);
  /// After the last point.
  void drawStrengths(const DriveOptions& options);

  View view_;
  Random random_;
  std::vector<Eigen::Vector3d> points_; ///< world, m
  std::vector<double> strengths_;       ///< the stronger, the more easily detected
  std::vector<std::uint64_t> looks_;    ///< of each point; empty: each has its own
};

/// A block of houses in a grid of streets: facades, poles, trees, things at ground level, streets beyond the
/// corners.
class StreetScene : public PointScene {
 public:
  StreetScene(const DriveOptions& options, const View& view);
  bool occluded(const Eigen::Vector3d& camera_world, const Eigen::Vector3d& point_world) const override;

 private:
  void addFacades();
  void addStreetsBeyond();
  void addFurniture();
  void repeatStreets();
  void add(double x, double y, double z);

  BlockPath path_;
  SE3 path_T_world_;
};

/// A room with some furniture, as full of points in one direction as in another.
class RoomScene : public PointScene {
 public:
  /// Around a body that stays within `around` (world, m).
  RoomScene(const DriveOptions& options, const View& view, const Eigen::AlignedBox3d& around);
};

/// Points that come into being wherever the camera looks. They occlude nothing and never return.
class OpenScene : public Scene {
 public:
  OpenScene(const DriveOptions& options, const View& view);
  std::vector<ScenePoint> detect(const SE3& world_T_cam, std::size_t count,
                                 const std::vector<std::uint64_t>& taken) override;

 private:
  View view_;
  Random random_;
  std::uint64_t next_index_ = 0;
};

} // namespace vi_ekf_slam::simulation
