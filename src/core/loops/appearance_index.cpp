#include "vi_ekf_slam/core/loops/appearance_index.hpp"

#include <algorithm>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"

namespace vi_ekf_slam {
namespace {

// Of the bits of the next one elsewhere (Lowe 2004 for distances): what looks alike in two places tells none.
constexpr double kRatio = 0.8;

} // namespace

bool mayBeSame(const Eigen::Vector3d& d, const Eigen::Matrix3d& covariance) {
  return squaredMahalanobis(d, covariance) < kChiSquare3;
}

// Two that have nothing in common differ by 128 bits, with a standard deviation of 8: of 10^6 comparisons
// none comes as near as kMostBits by chance.
bool MostAlike::isClear() const { return bits <= kMostBits && bits < kRatio * next_bits; }

LookUps::Candidates LookUps::candidates(const LandmarkMap& map) const {
  Candidates candidates;
  std::unordered_map<FeatureId, int> claims;
  for (std::size_t i = 0; i < map.active().size(); ++i) {
    const auto look_up = last_.find(map.active()[i].id);
    if (look_up == last_.end() || !look_up->second.known) continue;
    candidates.emplace_back(i, *look_up->second.known);
    ++claims[*look_up->second.known];
  }
  candidates.erase(std::remove_if(candidates.begin(), candidates.end(),
                                  [&claims](const auto& c) { return claims[c.second] > 1; }),
                   candidates.end());
  return candidates;
}

} // namespace vi_ekf_slam
