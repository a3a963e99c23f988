#include "vi_ekf_slam/core/loops/place_recogniser.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>
#include <tuple>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/map/points.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kLeastPoints = 40;   // on either side, for chance to be known
constexpr std::size_t kMostMatches = 6000; // proposed; what a fraction of a second can compare in pairs
constexpr double kTolerance = 0.4;         // m, of a point's place
constexpr double kLeastBaseline = 6.0;     // m, between the points of a transform
constexpr std::size_t kSeeds = 60;         // matches that agree with most others, from which transforms begin
constexpr int kTriples = 150;              // tried of each seed
constexpr std::size_t kLeastInliers = 14;
constexpr double kLeastShare = 0.18;  // of the points seen now where something was seen before
constexpr double kSeenBefore = 3.0;   // m, about a point that was
constexpr double kBeyondChance = 4.0; // times what the same points find a few metres off
constexpr double kRivalShare = 0.7;   // of the inliers, that another transform may not have
constexpr double kApart = 1.5;        // m at the vehicle, for a transform to be another one
constexpr double kLeastSpread = 4.0;  // m, standard deviation of the inliers along their second axis

// Of attempts that agree. Ten points 20 m away that fit to 0.4 m tell the shift to 0.2 m and the turn to
// 0.01 rad: three standard deviations of the difference, and what the way between adds.
constexpr double kSameShift = 1.0;  // m, at the vehicle
constexpr double kSameTurn = 0.05;  // rad
constexpr double kForgotten = 20.0; // times the way after which the two would differ by what the way adds

struct Match {
  Eigen::Vector3d now, before;
};

using Pairs = std::vector<std::pair<std::size_t, std::size_t>>; // indices of points (now, before)

/// The rotation and shift that move the points seen now onto those seen before best.
SE3 rigid(const std::vector<Match>& matches) {
  Eigen::Matrix3Xd now(3, matches.size()), before(3, matches.size());
  for (std::size_t i = 0; i < matches.size(); ++i) {
    now.col(static_cast<Eigen::Index>(i)) = matches[i].now;
    before.col(static_cast<Eigen::Index>(i)) = matches[i].before;
  }
  const Eigen::Matrix4d T = Eigen::umeyama(now, before, false);
  return SE3(T.topLeftCorner<3, 3>(), T.topRightCorner<3, 1>()).normalized();
}

/// What is possible under the covariance of the vehicle's pose.
class Gate {
 public:
  Gate(const Eigen::Vector3d& about, const Matrix6d& covariance)
      : about_(about),
        covariance_(covariance),
        turn_(3.0 * std::sqrt(covariance.diagonal().tail<3>().maxCoeff())) {}

  /// Whether a point at `now` may be the one at `before`.
  bool allows(const Eigen::Vector3d& now, const Eigen::Vector3d& before) const {
    const Eigen::Matrix<double, 3, 6> J = se3::pointJacobian(now - about_);
    Eigen::Matrix3d S = J * covariance_ * J.transpose();
    S.diagonal().array() += kTolerance * kTolerance;
    const Eigen::Vector3d d = before - now;
    return squaredMahalanobis(d, S) < kChiSquare3;
  }

  bool allows(const SE3& before_T_now) const {
    Vector6d d;
    d << before_T_now * about_ - about_, so3::Log(before_T_now.rotation());
    Matrix6d S = covariance_;
    S.diagonal().head<3>().array() += kTolerance * kTolerance;
    S.diagonal().tail<3>().array() += 1e-4;
    return squaredMahalanobis(d, S) < kChiSquare6;
  }

  /// Whether two matches can both be right: the same distance, and turned no more than the pose may be.
  bool agree(const Match& a, const Match& b) const {
    const Eigen::Vector3d u = b.now - a.now, v = b.before - a.before;
    const double length = u.norm();
    return length > kLeastBaseline && std::abs(v.norm() - length) < kTolerance &&
           (v - u).norm() < turn_ * length + kTolerance;
  }

 private:
  Eigen::Vector3d about_;
  Matrix6d covariance_;
  double turn_; // rad
};

/// The points seen now, each with its nearest one seen before after `before_T_now`, if near; one to one.
Pairs pairUp(const std::vector<PlacePoint>& now, const PointGrid& before, const SE3& before_T_now) {
  std::vector<std::tuple<double, std::size_t, std::size_t>> near;
  for (std::size_t i = 0; i < now.size(); ++i) {
    const auto found = before.nearest(before_T_now * now[i].position, kTolerance);
    if (found) near.emplace_back(found->second, i, found->first);
  }
  std::sort(near.begin(), near.end());
  Pairs pairs;
  std::vector<bool> taken(before.size(), false);
  for (const auto& [distance, i, j] : near) {
    if (taken[j]) continue;
    taken[j] = true;
    pairs.emplace_back(i, j);
  }
  return pairs;
}

std::vector<Match> matchesOf(const Pairs& pairs, const std::vector<PlacePoint>& now,
                             const std::vector<PlacePoint>& before) {
  std::vector<Match> matches;
  for (const auto& [i, j] : pairs) matches.push_back({now[i].position, before[j].position});
  return matches;
}

/// How many points find a partner where there is none to find: the same points, moved by some metres.
double byChance(const std::vector<PlacePoint>& now, const PointGrid& before, const SE3& before_T_now) {
  double sum = 0.0;
  for (const double x : {-3.0, 0.0, 3.0}) {
    for (const double y : {-3.0, 0.0, 3.0}) {
      if (x == 0.0 && y == 0.0) continue;
      const SE3 aside(Eigen::Matrix3d::Identity(), {x, y, 0.0});
      sum += static_cast<double>(pairUp(now, before, aside * before_T_now).size());
    }
  }
  return sum / 8.0;
}

/// How many of the points seen now are where something was seen before.
double overlap(const std::vector<PlacePoint>& now, const std::vector<Eigen::Vector3d>& before,
               const SE3& before_T_now) {
  const PointGrid grid(before, kSeenBefore);
  const auto inside = [&](const PlacePoint& p) {
    return grid.nearest(before_T_now * p.position, kSeenBefore).has_value();
  };
  return static_cast<double>(std::count_if(now.begin(), now.end(), inside));
}

struct Candidate {
  SE3 before_T_now;
  Pairs pairs;
};

} // namespace

std::optional<Recognition> recognisePlace(const std::vector<PlacePoint>& now,
                                          const std::vector<PlacePoint>& before, const Eigen::Vector3d& about,
                                          const Matrix6d& covariance) {
  if (now.size() < kLeastPoints || before.size() < kLeastPoints) return std::nullopt;
  const Gate gate(about, covariance);
  std::mt19937 engine(static_cast<unsigned>(now.size() + 1000 * before.size()));
  const auto pick = [&engine](std::size_t count) { return engine() % count; };

  std::vector<Match> matches;
  for (const PlacePoint& a : now) {
    for (const PlacePoint& b : before) {
      if (gate.allows(a.position, b.position)) matches.push_back({a.position, b.position});
    }
  }
  if (matches.size() < kLeastInliers) return std::nullopt;
  while (matches.size() > kMostMatches) {
    std::swap(matches[pick(matches.size())], matches.back());
    matches.pop_back();
  }

  std::vector<std::pair<std::size_t, std::size_t>> agreement(matches.size()); // (count, match)
  for (std::size_t i = 0; i < matches.size(); ++i) agreement[i].second = i;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (!gate.agree(matches[i], matches[j])) continue;
      ++agreement[i].first;
      ++agreement[j].first;
    }
  }
  std::sort(agreement.rbegin(), agreement.rend());
  agreement.resize(std::min(agreement.size(), kSeeds));

  std::vector<Eigen::Vector3d> points;
  for (const PlacePoint& point : before) points.push_back(point.position);
  const PointGrid grid(points, 1.0);
  std::vector<Candidate> candidates;
  for (const auto& [count, seed] : agreement) {
    std::vector<std::size_t> friends;
    for (std::size_t i = 0; i < matches.size(); ++i) {
      if (i != seed && gate.agree(matches[seed], matches[i])) friends.push_back(i);
    }
    if (friends.size() < kLeastInliers / 2) continue;
    Candidate best;
    std::ptrdiff_t most = 0;
    for (int trial = 0; trial < kTriples; ++trial) {
      const std::size_t b = friends[pick(friends.size())], c = friends[pick(friends.size())];
      if (b == c || !gate.agree(matches[b], matches[c])) continue;
      const SE3 before_T_now = rigid({matches[seed], matches[b], matches[c]});
      if (!gate.allows(before_T_now)) continue;
      const auto fits = std::count_if(friends.begin(), friends.end(), [&](std::size_t i) {
        return (before_T_now * matches[i].now - matches[i].before).squaredNorm() < kTolerance * kTolerance;
      });
      if (fits <= most) continue;
      most = fits;
      best.before_T_now = before_T_now;
    }
    if (most == 0) continue;
    best.pairs = pairUp(now, grid, best.before_T_now);
    for (int i = 0; i < 5 && best.pairs.size() >= 3; ++i) {
      best.before_T_now = rigid(matchesOf(best.pairs, now, before));
      best.pairs = pairUp(now, grid, best.before_T_now);
    }
    if (best.pairs.size() >= 3) candidates.push_back(std::move(best));
  }
  if (candidates.empty()) return std::nullopt;
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) { return a.pairs.size() > b.pairs.size(); });

  const Candidate& best = candidates.front();
  const auto inliers = static_cast<double>(best.pairs.size());
  std::vector<Eigen::Vector3d> found;
  for (const auto& [i, j] : best.pairs) found.push_back(now[i].position);
  if (best.pairs.size() < kLeastInliers || inliers < kLeastShare * overlap(now, points, best.before_T_now) ||
      !gate.allows(best.before_T_now) || inliers < kBeyondChance * byChance(now, grid, best.before_T_now) ||
      widthOf(found) < kLeastSpread)
    return std::nullopt;
  for (const Candidate& other : candidates) {
    const double apart = (other.before_T_now * about - best.before_T_now * about).norm();
    if (apart > kApart && static_cast<double>(other.pairs.size()) > kRivalShare * inliers)
      return std::nullopt;
  }
  Recognition recognition{best.before_T_now, {}};
  for (const auto& [i, j] : best.pairs) recognition.matches.emplace_back(now[i].id, before[j].id);
  return recognition;
}

bool PlaceAgreement::confirms(const Recognition& found, const Eigen::Vector3d& about, double way) {
  const auto begin = [&] {
    first_ = {found, about};
    agreed_ = 1;
    return false;
  };
  if (!first_) return begin();
  const double driven = (about - first_->about).norm();
  const SE3& a = first_->recognition.before_T_now;
  const SE3& b = found.before_T_now;
  if (driven > kForgotten * way || (a * about - b * about).norm() > kSameShift ||
      so3::Log(a.rotation().transpose() * b.rotation()).norm() > kSameTurn)
    return begin();
  ++agreed_;
  const auto& known = first_->recognition.matches;
  const auto is_new = [&known](const auto& match) {
    return std::none_of(known.begin(), known.end(), [&match](const auto& other) {
      return other.first == match.first || other.second == match.second;
    });
  };
  const auto others = std::count_if(found.matches.begin(), found.matches.end(), is_new);
  return driven >= way && agreed_ >= attempts_ && static_cast<std::size_t>(others) >= least_;
}

} // namespace vi_ekf_slam
