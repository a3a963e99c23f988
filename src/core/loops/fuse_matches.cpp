#include "vi_ekf_slam/core/loops/fuse_matches.hpp"

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/sensors/median.hpp"

namespace vi_ekf_slam {
namespace {

// Wider, since what the pairs have in common is an error of the way since, which is not quite normal; that
// they agree is what speaks for them.
constexpr double kCommonGate = 4.0 * kChiSquare3;
constexpr double kJointGate = 5.0; // of the joint chi-square, per degree of freedom

/// The pairs that agree, each by itself and once `h` is believed.
std::vector<bool> agreeing(const Innovation& in, std::size_t h) {
  const Eigen::Matrix3d own = in.S(h, h);
  const Eigen::Vector3d residual = in.measurements()[h].residual();
  const Eigen::Vector3d weighted = solvePositive(own, residual);
  std::vector<bool> agrees(in.measurements().size(), false);
  if (!(residual.dot(weighted) < kCommonGate)) return agrees;
  for (std::size_t j = 0; j < agrees.size(); ++j) {
    if (j == h) {
      agrees[j] = true;
      continue;
    }
    const Eigen::Matrix3d cross =
        j > h ? Eigen::Matrix3d(in.S(j, h)) : Eigen::Matrix3d(in.S(h, j).transpose());
    const Eigen::Vector3d left = Eigen::Vector3d(in.measurements()[j].residual()) - cross * weighted;
    const Eigen::Matrix3d covariance =
        Eigen::Matrix3d(in.S(j, j)) - cross * solvePositive(own, Eigen::Matrix3d(cross.transpose()));
    agrees[j] = squaredMahalanobis(left, covariance) < kChiSquare3;
  }
  return agrees;
}

} // namespace

std::vector<bool> largestAgreement(const Innovation& in) {
  std::vector<bool> best(in.measurements().size(), false);
  std::size_t most = 0;
  for (std::size_t h = 0; h < best.size(); ++h) {
    std::vector<bool> agrees = agreeing(in, h);
    const std::size_t count = countTrue(agrees);
    if (count <= most) continue;
    most = count;
    best.swap(agrees);
  }
  return best;
}

std::vector<bool> fuseDuplicates(Filter& filter, const std::vector<Duplicate>& pairs, std::size_t least,
                                 double sigma) {
  const std::vector<bool> none(pairs.size(), false);
  if (pairs.empty()) return none;
  filter.settle();
  const Variables& variables = filter.variables();
  std::vector<LinearMeasurement> same; // x_now = x_before: y_now - y_before = x_before^ - x_now^
  for (const Duplicate& pair : pairs) {
    same.push_back(
        LinearMeasurement(variables.point(pair.before) - variables.point(pair.now), isotropic(sigma))
            .by(filter.rowOf(pair.now), Eigen::Matrix3d::Identity())
            .by(filter.rowOf(pair.before), -Eigen::Matrix3d::Identity()));
  }
  Innovation in(filter.covariance(), std::move(same));
  const std::vector<bool> best = largestAgreement(in);
  const std::size_t most = countTrue(best);
  if (most == 0 || most < least) return none;
  in.putFirst(best);
  in.drop();
  // Straight coordinates: a correction that moves all rigidly must not bend what lies before the camera.
  if (!in.factorise() || !(in.nis() <= kJointGate * 3.0 * static_cast<double>(most)) || !filter.correct(in))
    return none;
  return best;
}

Revisit fuseMatches(Filter& filter, LandmarkMap& map, const Matches& matches, std::size_t least,
                    double sigma) {
  const auto index = map.indexById();
  const std::size_t first = map.active().size();
  std::vector<FeatureId> ids;
  for (const auto& [is_now, was] : matches) ids.push_back(was);
  map.reactivate(filter, ids);
  std::vector<Duplicate> duplicates;
  for (std::size_t i = 0; i < matches.size(); ++i)
    duplicates.push_back(
        {map.active()[index.at(matches[i].first)].variable, map.active()[first + i].variable});
  const std::vector<bool> fused = fuseDuplicates(filter, duplicates, least, sigma);
  std::vector<Stamp> last_seen;
  // From behind: whoever takes a place comes from behind it.
  for (std::size_t i = matches.size(); i-- > 0;) {
    if (!fused[i]) {
      map.deactivate(filter, first + i);
      continue;
    }
    const Landmark& before = map.active()[first + i];
    Landmark& landmark = map.active(index.at(matches[i].first));
    last_seen.push_back(before.last_seen);
    landmark.observations += before.observations;
    landmark.descriptors.add(before.descriptors);
    landmark.in_map = true;
    map.discard(filter, first + i);
  }
  return {last_seen.size(), last_seen.empty() ? 0 : medianOf(last_seen)};
}

} // namespace vi_ekf_slam
