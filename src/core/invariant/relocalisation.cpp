// How InvariantEstimator finds its place in a loaded map, by ids that return.

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <utility>

#include "vi_ekf_slam/core/invariant/invariant_estimator.hpp"
#include "vi_ekf_slam/core/invariant/jump.hpp"
#include "vi_ekf_slam/core/so3.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr std::size_t kTellingObservations = 3; // of a landmark in view
constexpr std::size_t kLeastPoints = 6, kMostPoints = 100;
constexpr std::size_t kLeastFused = 5;
constexpr int kFramesBetween = 5;      // attempts
constexpr int kFramesBetweenFailures = 50; // of the costly part
constexpr double kCornerSigma = 0.1;   // m, by which a front end finds a corner elsewhere another time
constexpr double kAgreement = 13.93;   // chi-square, 3 degrees of freedom, 99.7 %
constexpr double kLeastSpread = 0.5;   // m, of the points beside the line that they are nearest to
// Where the drive is in the map is not known beforehand, so that the landmarks alone tell. m, rad.
constexpr double kAnyPosition = 1e3, kAnyRotation = 2.0;

/// The covariance (3x3 each) of points beside the motion of all of them as one rigid body, of their joint covariance C
/// (3n x 3n): with G's columns the six directions of that motion, of (I - G G^+) C (I - G G^+).
std::vector<Eigen::Matrix3d> shapeCovariances(const std::vector<Eigen::Vector3d>& points, Eigen::MatrixXd C) {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) centre += p / static_cast<double>(points.size());
  Eigen::MatrixXd G(C.rows(), 6);
  for (std::size_t i = 0; i < points.size(); ++i)
    G.middleRows<3>(3 * static_cast<Eigen::Index>(i)) << Eigen::Matrix3d::Identity(), -so3::hat(points[i] - centre);
  const Eigen::MatrixXd Q =
      Eigen::HouseholderQR<Eigen::MatrixXd>(G).householderQ() * Eigen::MatrixXd::Identity(C.rows(), 6);
  C -= (Q * (Q.transpose() * C)).eval();
  C -= ((C * Q) * Q.transpose()).eval();
  std::vector<Eigen::Matrix3d> own;
  for (Eigen::Index row = 0; row < C.rows(); row += 3) {
    const Eigen::Matrix3d block = C.block<3, 3>(row, row);
    own.push_back(0.5 * (block + block.transpose()));
  }
  return own;
}

/// The 3x3 blocks of P at these rows.
Eigen::MatrixXd blocksOf(const Eigen::Ref<const Eigen::MatrixXd>& P, const std::vector<Eigen::Index>& rows) {
  const auto n = static_cast<Eigen::Index>(rows.size());
  Eigen::MatrixXd C(3 * n, 3 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j)
      C.block<3, 3>(3 * i, 3 * j) =
          P.block<3, 3>(rows[static_cast<std::size_t>(i)], rows[static_cast<std::size_t>(j)]);
  }
  return C;
}

/// Whether the points tell how they are turned: they are not all near one line.
bool spansAPlane(const std::vector<Displaced>& points) {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const Displaced& p : points) centre += p.expected / static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Displaced& p : points)
    scatter += (p.expected - centre) * (p.expected - centre).transpose() / static_cast<double>(points.size());
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvalues()[1] > kLeastSpread * kLeastSpread;
}

} // namespace

void InvariantEstimator::relocaliseIn(std::shared_ptr<const SavedMap> map) {
  LoadedMap loaded{std::move(map), {}, 0};
  for (std::size_t i = 0; i < loaded.map->landmarks.size(); ++i) loaded.index.emplace(loaded.map->landmarks[i].id, i);
  loaded_ = std::move(loaded);
  map_use_ = MapUse::kWaiting;
}

/// The drive so far is in a frame of its own. When landmarks in view have ids of the map and their constellation is the
/// map's, all is moved there; where they do not agree it goes on as if nothing had been tried.
void InvariantEstimator::relocalise(FrameReport& report) {
  if (--loaded_->frames_until_attempt > 0) return;
  loaded_->frames_until_attempt = kFramesBetween;
  SE3 map_T_session;
  const std::vector<FeatureId> ids = agreeingWithMap(map_T_session);
  if (ids.size() < kLeastPoints) return;
  if (!moveIntoMap(map_T_session, ids)) {
    loaded_->frames_until_attempt = kFramesBetweenFailures;
    return;
  }
  report.relocalised = true;
  loaded_.reset();
  map_use_ = MapUse::kRelocalised;
}

/// Ids of landmarks in view that lie in the map as they lie here, and how the one lies in the other; none where too few
/// do.
std::vector<FeatureId> InvariantEstimator::agreeingWithMap(SE3& map_T_session) const {
  const SavedMap& map = *loaded_->map;
  std::vector<FeatureId> ids;
  std::vector<Eigen::Vector3d> here, there;
  std::vector<Eigen::Index> rows_here, rows_there;
  for (std::size_t i = 0; i < state_.landmarks().size() && ids.size() < kMostPoints; ++i) {
    const Landmark& l = state_.landmarks()[i];
    const auto known = loaded_->index.find(l.id);
    if (l.observations < kTellingObservations || l.anchored || known == loaded_->index.end()) continue;
    ids.push_back(l.id);
    here.push_back(l.position);
    there.push_back(map.landmarks[known->second].position);
    rows_here.push_back(State::offsetOf(i));
    rows_there.push_back(State::offsetOf(known->second));
  }
  if (ids.size() < kLeastPoints) return {};
  const auto shape_here = shapeCovariances(here, blocksOf(state_.covariance(), rows_here));
  const auto shape_there = shapeCovariances(there, blocksOf(map.covariance, rows_there));
  std::vector<Displaced> points;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    // How the one is turned against the other is not known yet: the larger of the other's variances in every direction.
    const double variance_here = shape_here[i].selfadjointView<Eigen::Lower>().eigenvalues().maxCoeff();
    points.push_back({there[i], here[i],
                      shape_there[i] +
                          (variance_here + kCornerSigma * kCornerSigma) * Eigen::Matrix3d::Identity()});
  }
  const auto motion = commonMotion(points);
  if (!motion) return {};
  map_T_session = *motion;
  std::vector<FeatureId> agreeing;
  std::vector<Displaced> chosen;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const Eigen::Vector3d apart = points[i].expected - *motion * points[i].seen;
    if (!(apart.dot(points[i].covariance.llt().solve(apart)) < kAgreement)) continue;
    agreeing.push_back(ids[i]);
    chosen.push_back(points[i]);
  }
  return spansAPlane(chosen) ? agreeing : std::vector<FeatureId>();
}

/// Moves the state into the map's frame, as unsure of where it is there as can be, and fuses its landmarks of these ids with
/// the map's, which tells. False, and no change, where these contradict the joint covariance. What this drive saw before
/// stays in the map as estimates without correlation.
bool InvariantEstimator::moveIntoMap(const SE3& map_T_session, const std::vector<FeatureId>& ids) {
  const SavedMap& map = *loaded_->map;
  State before = state_;
  const bool loop_closed = loop_closed_;
  auto recalled = std::exchange(recalled_, {});
  auto disputed = std::exchange(disputed_, {});
  state_.marginaliseOldest(state_.inactive().size());
  for (std::size_t i = state_.landmarks().size(); i-- > 0;) {
    if (state_.landmarks()[i].anchored) state_.removeLandmark(i); // recalled, and not seen since
  }
  state_.moveWorld(map_T_session);
  Vector6d any;
  any << Eigen::Vector3d::Constant(kAnyPosition), Eigen::Vector3d::Constant(kAnyRotation);
  // Turning by w about p: xi_R = w, xi_p = [p]x w.
  Matrix6d J = Matrix6d::Identity();
  J.topRightCorner<3, 3>() = so3::hat(state_.pose().translation());
  state_.loosen(J * any.cwiseAbs2().asDiagonal() * J.transpose());
  std::vector<Landmark> landmarks;
  for (const SavedLandmark& l : map.landmarks) landmarks.push_back({l.id, l.position, l.observations});
  const Eigen::Index k3 = map.covariance.rows() - kSavedBase;
  state_.adopt(std::move(landmarks), map.covariance.bottomRightCorner(k3, k3));
  if (fuseReturned(ids, kLeastFused) < kLeastFused || !isSound(true)) {
    state_ = std::move(before);
    recalled_ = std::move(recalled);
    disputed_ = std::move(disputed);
    loop_closed_ = loop_closed;
    return false;
  }
  for (const InactiveLandmark& l : before.inactiveLandmarks(InactiveMap::Covariances::kLastSettled))
    archive_.put({l.landmark.id, l.landmark.position, l.covariance});
  Matrix6d turned = Matrix6d::Zero(); // the error of the pose within this drive, along the map's axes
  for (const Eigen::Index at : {0, 3}) turned.block<3, 3>(at, at) = map_T_session.rotation();
  const Matrix6d own = turned * before.poseCovariance() * turned.transpose();
  archive_.move(map_T_session, state_.pose().translation(), 2.0 * (own + state_.poseCovariance()));
  drift_ = Drift(config_.drift_position, config_.drift_rotation);
  return true;
}

} // namespace vi_ekf_slam::invariant
