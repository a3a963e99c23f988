#include "vi_ekf_slam/core/loops/relocaliser.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <utility>

#include "vi_ekf_slam/core/filter/pose_reset.hpp"
#include "vi_ekf_slam/core/filter/validity.hpp"
#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/rigid_consensus.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/loops/fuse_matches.hpp"
#include "vi_ekf_slam/core/map/points.hpp"
#include "vi_ekf_slam/core/map/snapshot.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kTellingObservations = 3; // of a landmark in view
constexpr std::size_t kMostPoints = 100;
constexpr std::size_t kLeastFused = 5;
constexpr double kBetweenTries = 0.5;      // s
constexpr double kBetweenFailures = 5.0;   // s, of the costly part
constexpr double kShareOfMatches = 0.6;    // of the matches, that must agree
constexpr double kShareOfLooks = 0.4;      // the same where looks alone say that they are
constexpr std::size_t kLookUpsInATry = 25; // in a try: with 4000 landmarks two milliseconds
constexpr double kLeastWidth = 0.5;        // m, of the points beside the line that they are nearest to
constexpr double kLevel = 0.1;             // rad, between the vertical of two maps

/// Of the first of a point's three coordinates.
Eigen::Index rowOf(std::size_t point) { return 3 * static_cast<Eigen::Index>(point); }

/// What shifting and turning all points (about their centre) by (dt, dphi) does to each: [I, -[p - c]x].
Eigen::MatrixXd rigidMotions(const std::vector<Eigen::Vector3d>& points) {
  const Eigen::Vector3d centre = centreOf(points);
  Eigen::MatrixXd G(rowOf(points.size()), 6);
  for (std::size_t i = 0; i < points.size(); ++i)
    G.middleRows<3>(rowOf(i)) = se3::pointJacobian(points[i] - centre);
  return G;
}

/// The covariance (3x3 each) of points beside the motion of all of them as one rigid body, as it is told from
/// those of large weight, of their joint covariance C (3n x 3n): of (I - G (G^T W G)^-1 G^T W) C (...)^T.
std::vector<Eigen::Matrix3d> shapeCovariances(const std::vector<Eigen::Vector3d>& points, Eigen::MatrixXd C,
                                              const Eigen::VectorXd& weights) {
  const Eigen::MatrixXd G = rigidMotions(points), WG = weights.asDiagonal() * G;
  const Matrix6d information = G.transpose() * WG;
  const Eigen::MatrixXd A =
      information.ldlt().solve(G.transpose()).transpose(); // singular, if all are in a line
  const Eigen::MatrixXd GWC = WG.transpose() * C;
  C.noalias() -= A * GWC;
  const Eigen::MatrixXd CWG = C * WG;
  C.noalias() -= CWG * A.transpose();
  std::vector<Eigen::Matrix3d> own;
  for (Eigen::Index row = 0; row < C.rows(); row += 3) {
    const Eigen::Matrix3d block = C.block<3, 3>(row, row);
    own.push_back(0.5 * (block + block.transpose()));
  }
  return own;
}

/// The 3x3 blocks of P at these rows.
Eigen::MatrixXd blocksOf(const Eigen::Ref<const Eigen::MatrixXd>& P, const std::vector<Eigen::Index>& rows) {
  Eigen::MatrixXd C(rowOf(rows.size()), rowOf(rows.size()));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (std::size_t j = 0; j < rows.size(); ++j)
      C.block<3, 3>(rowOf(i), rowOf(j)) = P.block<3, 3>(rows[i], rows[j]);
  }
  return C;
}

/// Landmarks that are here (in this drive's frame) and there (in the map's), with the joint covariance of
/// their errors in either frame (3n x 3n).
struct MatchedPoints {
  std::vector<std::size_t> which; ///< of the candidates
  std::vector<Eigen::Vector3d> here, there;
  Eigen::MatrixXd covariance_here, covariance_there;
  Eigen::VectorXd weights; ///< 3n, 1/m^2: how well each is known from the vehicle

  void leaveOut(std::size_t one) {
    MatchedPoints kept;
    std::vector<Eigen::Index> rows;
    for (std::size_t i = 0; i < which.size(); ++i) {
      if (i == one) continue;
      kept.which.push_back(which[i]);
      kept.here.push_back(here[i]);
      kept.there.push_back(there[i]);
      rows.push_back(rowOf(i));
    }
    kept.covariance_here = blocksOf(covariance_here, rows);
    kept.covariance_there = blocksOf(covariance_there, rows);
    *this = std::move(kept);
  }
};

/// The rigid transform there_T_here on which at least `share` of them agree, whatever the others are.
std::optional<SE3> roughAlignment(const MatchedPoints& m, double share) {
  const auto shape_here = shapeCovariances(m.here, m.covariance_here, m.weights);
  const auto shape_there = shapeCovariances(m.there, m.covariance_there, m.weights);
  std::vector<Displaced> points;
  for (std::size_t i = 0; i < m.which.size(); ++i) {
    // How the one is turned against the other is not known yet: its largest variance in every direction.
    const double variance = shape_here[i].selfadjointView<Eigen::Lower>().eigenvalues().maxCoeff();
    points.push_back(
        {m.there[i], m.here[i],
         shape_there[i] + (variance + kCornerSigma * kCornerSigma) * Eigen::Matrix3d::Identity()});
  }
  return commonMotion(points, share);
}

/// Leaves out the match that contradicts the others most, under the joint covariance, until none does; the
/// others' transform is `there_T_here` from then on. With S the covariance of what is left of all, and r =
/// S^-1 innovation, what one is off by, given the others, has the chi-square r_i^T ((S^-1)_ii)^-1 r_i.
void keepCompatible(MatchedPoints& m, SE3& there_T_here) {
  while (m.which.size() >= Relocaliser::kLeastMatches) {
    const Eigen::Index n = rowOf(m.which.size());
    std::vector<Eigen::Vector3d> moved;
    Eigen::VectorXd innovation(n);
    for (std::size_t i = 0; i < m.which.size(); ++i) {
      moved.push_back(there_T_here * m.here[i]);
      innovation.segment<3>(rowOf(i)) = m.there[i] - moved[i];
    }
    const Eigen::Matrix3d& R = there_T_here.rotation();
    Eigen::MatrixXd S = m.covariance_there;
    for (Eigen::Index i = 0; i < n; i += 3) {
      for (Eigen::Index j = 0; j < n; j += 3)
        S.block<3, 3>(i, j) += R * m.covariance_here.block<3, 3>(i, j) * R.transpose();
    }
    S.diagonal().array() += kCornerSigma * kCornerSigma;
    const Eigen::MatrixXd G = rigidMotions(moved);
    const Eigen::MatrixXd prior = G * anyPose().diagonal().asDiagonal();
    S.noalias() += prior * G.transpose();
    const Eigen::MatrixXd inverse = S.llt().solve(Eigen::MatrixXd::Identity(n, n));
    const Eigen::VectorXd r = inverse * innovation;
    std::size_t worst = 0;
    double most = 0.0;
    for (std::size_t i = 0; i < m.which.size(); ++i) {
      const Eigen::Vector3d own = r.segment<3>(rowOf(i));
      const double chi_square = squaredMahalanobis(own, inverse.block<3, 3>(rowOf(i), rowOf(i)));
      if (chi_square > most) {
        most = chi_square;
        worst = i;
      }
    }
    const Vector6d motion = prior.transpose() * r; // the transform's error, as the matches have it
    const Eigen::Vector3d centre = centreOf(moved);
    const Eigen::Matrix3d turn = so3::Exp(motion.tail<3>());
    there_T_here = (SE3(turn, centre - turn * centre + motion.head<3>()) * there_T_here).normalized();
    if (!(most > kChiSquare3)) return;
    m.leaveOut(worst);
  }
}

/// Of the landmarks, which have been moved with a filter that was `before` and is `after`.
void moveArchive(const SE3& map_T_session, const Filter& before, const Filter& after,
                 LandmarkMap& landmarks) {
  // Of the error of the pose within this drive, along the map's axes.
  const Matrix6d turned = SE3(map_T_session.rotation(), Eigen::Vector3d::Zero()).adjoint();
  const Matrix6d own = before.covariance().topLeftCorner<6, 6>();
  const Matrix6d alignment =
      turned * own * turned.transpose() + Matrix6d(after.covariance().topLeftCorner<6, 6>());
  landmarks.archive().move(map_T_session, after.pose().translation(), 2.0 * alignment);
}

} // namespace

Relocaliser::Relocaliser(std::shared_ptr<const SavedMap> map)
    : map_(std::move(map)), look_ups_(kLookUpsInATry), agreement_(PlaceAgreement::byLooks()) {
  std::vector<KnownLook> known;
  for (std::size_t i = 0; i < map_->landmarks.size(); ++i) {
    const SavedLandmark& l = map_->landmarks[i];
    index_.emplace(l.id, i);
    if (l.descriptors.isEmpty()) continue;
    const Eigen::Index row = map_->rowOf(i);
    known.push_back({i, l.position, map_->covariance.block<3, 3>(row, row), l.descriptors});
  }
  known_ = AppearanceIndex(std::move(known));
}

bool Relocaliser::update(Filter& filter, LandmarkMap& landmarks, ReturningLandmarks& returning, Stamp now) {
  if (next_attempt_ && now < *next_attempt_) return false;
  next_attempt_ = now + fromSeconds(kBetweenTries);
  std::optional<Place> place = find(filter, landmarks, candidatesById(landmarks), kShareOfMatches);
  if (!place) place = findByLooks(filter, landmarks);
  if (!place) return false;
  if (moveTo(*place, filter, landmarks, returning)) return true;
  next_attempt_ = now + fromSeconds(kBetweenFailures);
  return false;
}

Relocaliser::Candidates Relocaliser::candidatesById(const LandmarkMap& landmarks) const {
  Candidates candidates;
  for (std::size_t i = 0; i < landmarks.active().size(); ++i) {
    const Landmark& l = landmarks.active()[i];
    const auto known = index_.find(l.id);
    if (l.observations >= kTellingObservations && !l.reactivated && known != index_.end())
      candidates.emplace_back(i, known->second);
  }
  return candidates;
}

/// Each that is looked up is compared with the whole map: where the vehicle is, is not known.
std::optional<Relocaliser::Place> Relocaliser::findByLooks(const Filter& filter,
                                                           const LandmarkMap& landmarks) {
  if (known_.isEmpty()) return std::nullopt;
  look_ups_.update(
      landmarks, known_,
      [](const Landmark& l) { return l.observations >= kTellingObservations && !l.descriptors.isEmpty(); },
      [](const Landmark&) { return [](const KnownLook&) { return true; }; });
  auto place = find(filter, landmarks, look_ups_.candidates(landmarks), kShareOfLooks);
  if (!place) return std::nullopt;
  place->by_id = false;
  Recognition recognition{place->map_T_session, {}};
  std::vector<Eigen::Vector3d> there;
  for (const auto& [id, known] : place->matches) {
    recognition.matches.emplace_back(id, known);
    there.push_back(map_->landmarks[known].position);
  }
  const Eigen::Vector3d about = filter.pose().translation();
  const double distance = (centreOf(there) - place->map_T_session * about).norm();
  if (!agreement_.confirms(recognition, about, PlaceAgreement::kWayByLooks * distance)) return std::nullopt;
  agreement_.restart();
  return place;
}

std::optional<Relocaliser::Place> Relocaliser::find(const Filter& filter, const LandmarkMap& landmarks,
                                                    const Candidates& candidates, double share) const {
  const std::size_t matches = std::min(candidates.size(), kMostPoints);
  if (matches < kLeastMatches) return std::nullopt;
  MatchedPoints m;
  std::vector<Eigen::Index> rows_here, rows_there;
  for (std::size_t i = 0; i < matches; ++i) {
    const Landmark& l = landmarks.active()[candidates[i].first];
    m.which.push_back(i);
    m.here.push_back(filter.variables().point(l.variable));
    m.there.push_back(map_->landmarks[candidates[i].second].position);
    rows_here.push_back(filter.rowOf(l.variable));
    rows_there.push_back(map_->rowOf(candidates[i].second));
  }
  m.covariance_here = blocksOf(filter.covariance(), rows_here);
  m.covariance_there = blocksOf(map_->covariance, rows_there);
  m.weights.resize(rowOf(matches));
  for (std::size_t i = 0; i < matches; ++i) {
    const double variance = m.covariance_here.block<3, 3>(rowOf(i), rowOf(i)).trace() / 3.0;
    m.weights.segment<3>(rowOf(i)).setConstant(1.0 / (variance + kCornerSigma * kCornerSigma));
  }
  const auto motion = roughAlignment(m, share);
  if (!motion) return std::nullopt;
  Place place{*motion, {}};
  keepCompatible(m, place.map_T_session);
  const bool enough = m.which.size() >= kLeastMatches &&
                      static_cast<double>(m.which.size()) >= share * static_cast<double>(matches);
  if (!enough || widthOf(m.there) <= kLeastWidth) return std::nullopt;
  for (const std::size_t i : m.which)
    place.matches.emplace_back(landmarks.active()[candidates[i].first].id, candidates[i].second);
  return place;
}

/// All is where it is in the map's frame, as unsure of where the vehicle is there as can be. What this drive
/// saw before stays in the map as estimates without correlation.
void Relocaliser::enter(const SE3& map_T_session, Filter& filter, LandmarkMap& landmarks,
                        bool renumbered) const {
  landmarks.bound(filter, true);
  for (std::size_t i = landmarks.active().size(); i-- > 0;) {
    if (landmarks.active()[i].reactivated) landmarks.discard(filter, i);
  }
  filter.moveWorld(map_T_session);
  filter.addNoise(0, anyPose(filter.isLevel()));
  const Eigen::Index rows = map_->covariance.rows() - map_->base();
  landmarks.adopt(filter, *map_, loadedCovariance(*map_, anyPose()).bottomRightCorner(rows, rows),
                  Eigen::MatrixXd::Zero(filter.rows(), rows), renumbered);
}

bool Relocaliser::placeAt(const SE3& pose, const Matrix6d& covariance, Filter& filter,
                          LandmarkMap& landmarks) const {
  Filter moved = filter;
  LandmarkMap map = landmarks;
  const SE3 there = filter.isLevel() ? levelled(pose, filter.pose()) : pose;
  const SE3 map_T_session = there * filter.pose().inverse();
  enter(map_T_session, moved, map);
  if (!tellPose(moved, there, covariance)) return false;
  moved.settle();
  moveArchive(map_T_session, filter, moved, map);
  filter = std::move(moved);
  landmarks = std::move(map);
  return true;
}

/// The vehicle's landmarks of these matches are fused with the map's, which tells where it is there.
bool Relocaliser::moveTo(const Place& place, Filter& filter, LandmarkMap& landmarks,
                         ReturningLandmarks& returning) const {
  Filter moved = filter;
  LandmarkMap map = landmarks;
  ReturningLandmarks returning_there = returning;
  returning_there.restart();
  SE3 map_T_session = place.map_T_session;
  if (filter.isLevel()) {
    // Both maps' z axes point up: what the points tell of the tilt is their noise, or not this place.
    const SE3 there = map_T_session * filter.pose(), level = levelled(there, filter.pose());
    if (so3::Log(level.rotation().transpose() * there.rotation()).norm() > kLevel) return false;
    map_T_session = level * filter.pose().inverse();
  }
  enter(map_T_session, moved, map, !place.by_id);
  std::size_t fused = 0;
  if (place.by_id) {
    std::vector<FeatureId> ids;
    for (const auto& [id, known] : place.matches) ids.push_back(id);
    fused = returning_there.fuse(moved, map, ids, kLeastFused).landmarks;
  } else {
    Matches matches;
    for (const auto& [id, known] : place.matches) matches.emplace_back(id, LandmarkMap::kRenumbered + known);
    fused = fuseMatches(moved, map, matches, kLeastFused, kCornerSigma).landmarks;
  }
  if (fused < kLeastFused || !isValid(moved, true)) return false;
  moveArchive(map_T_session, filter, moved, map);
  filter = std::move(moved);
  landmarks = std::move(map);
  returning = std::move(returning_there);
  return true;
}

} // namespace vi_ekf_slam
