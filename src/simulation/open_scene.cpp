#include <cmath>

#include "vi_ekf_slam/simulation/scene.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr int kTriesPerPoint = 20; // near points fail only where their right pixel leaves the image

} // namespace

OpenScene::OpenScene(const DriveOptions& options, const View& view)
    : view_(view), random_(options.seed, RandomStream::kScene) {}

std::vector<ScenePoint> OpenScene::detect(const SE3& world_T_cam, std::size_t count,
                                          const std::vector<std::uint64_t>& /*taken*/) {
  const StereoCamera& camera = view_.rig.camera;
  const double near = std::min(2.0 * view_.min_depth, 0.5 * (view_.min_depth + view_.max_depth));
  std::vector<ScenePoint> found;
  for (std::size_t tries = 0; found.size() < count && tries < count * kTriesPerPoint; ++tries) {
    const double u = random_.uniform(0.0, view_.width), v = random_.uniform(0.0, view_.height);
    const double depth = near * std::pow(view_.max_depth / near, random_.uniform());
    const Eigen::Vector3d p((u - camera.cu) / camera.fu * depth, (v - camera.cv) / camera.fv * depth, depth);
    if (view_.sees(p)) found.push_back({next_index_++, world_T_cam * p});
  }
  return found;
}

} // namespace vi_ekf_slam::simulation
