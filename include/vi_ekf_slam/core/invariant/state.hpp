#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/invariant/inactive_map.hpp"
#include "vi_ekf_slam/core/invariant/landmark.hpp"
#include "vi_ekf_slam/core/invariant/relative_update.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam::invariant {

/// Where the parts of the error vector begin. Landmark i's three rows begin at kLandmarks + 3 i.
constexpr Eigen::Index kPosition = 0, kRotation = 3, kTwist = 6, kBias = 12, kLandmarks = 18;

/// Standard deviations of the state before anything was measured, per axis.
struct Prior {
  Vector6d pose_sigma;  ///< m, rad
  Vector6d twist_sigma; ///< m/s, rad/s
  Vector6d bias_sigma;  ///< m/s, rad/s
};

/// 6x6 of (xi_p, xi_R) as the covariance of (position, rotation) along the world axes for a body at
/// `position` (world, m): dp = xi_p - [position]x xi_R.
Matrix6d alongWorldAxes(const Matrix6d& covariance, const Eigen::Vector3d& position);

/// A measurement that is ready to correct a state: PHt = P H^T (size() x rows), the factor of the
/// innovation's covariance S = H P H^T + R (rows x rows), and the innovation.
class Correction {
 public:
  /// Of `S` only the lower triangle is read. `H` may be left out for a state that keeps no inactive
  /// landmarks. `noise` is the covariance of each three rows' noise where it is the same for all, and
  /// independent: not needed, but with it a state that keeps inactive landmarks has less to do.
  Correction(PooledMatrix PHt, PooledMatrix S, Pooled<Eigen::VectorXd> innovation,
             SparseRows H = SparseRows(0), const std::optional<Eigen::Matrix3d>& noise = {});

  /// Whether S is positive definite and all of this finite; else it cannot be applied.
  bool isValid() const { return valid_; }
  /// Normalised innovation squared, innovation^T S^-1 innovation.
  double nis() const { return nis_; }
  /// What the state's error is expected to be, P H^T S^-1 innovation (size()).
  const Pooled<Eigen::VectorXd>& error() const { return error_; }

 private:
  friend class State;

  std::optional<RelativeUpdate> relative() const;
  KalmanUpdate takeUpdate(PooledMatrix Kt);

  PooledMatrix PHt_;
  PooledMatrix L_; // lower triangle: S = L L^T
  SparseRows H_;
  std::optional<Eigen::Matrix3d> noise_; // where S^-1 can be had by it
  Pooled<Eigen::VectorXd> weighted_;     // S^-1 innovation
  Pooled<Eigen::VectorXd> error_;
  double nis_ = 0.0;
  bool valid_ = false;
};

/// Continuous-time white noise that drives the state, as root spectral densities per axis.
struct ProcessNoise {
  Vector6d twist_density; ///< m/s^1.5, rad/s^1.5: the twist is a random walk
  Vector6d bias_density;  ///< m/s^1.5, rad/s^1.5: so are the biases
};

/// Mean and covariance of pose T = world_T_imu, body twist nu = (v, omega), bias b of the twist's measurement
/// and landmarks m, with the right-invariant error (Barrau and Bonnabel, "An EKF-SLAM algorithm with
/// consistency properties", arXiv:1510.06263):
///
///   T = Exp(xi) T^,   m = Exp(xi_R) (m^ + e),   nu = nu^ + dnu,   b = b^ + db,
///
/// stacked as (xi_p, xi_R, dnu, db, e_1, e_2, ...), world axes for xi and e. A rotation or shift of the whole
/// world is a direction of this error that does not depend on the estimate, so no update can gain
/// information about it. The covariance changes only through the operations below; all keep it symmetric.
///
/// Landmarks out of view can stay in the joint covariance as inactive ones (see InactiveMap).
class State {
 public:
  /// `deferred_bytes` as InactiveMap has it.
  explicit State(const Prior& prior, bool keeps_inactive = false,
                 std::size_t deferred_bytes = std::size_t{1} << 31);

  const SE3& pose() const { return pose_; }
  const Vector6d& twist() const { return twist_; }
  const Vector6d& bias() const { return bias_; }
  const PooledVector<Landmark>& landmarks() const { return landmarks_; }
  /// Where each landmark is in landmarks(), by id; the first one of those that share an id.
  PooledHashMap<FeatureId, std::size_t> indexById() const;
  Eigen::Index size() const { return offsetOf(landmarks_.size()); }
  static Eigen::Index offsetOf(std::size_t landmark) { return kLandmarks + rowsOf(landmark); }
  /// size() x size(), symmetric.
  auto covariance() const { return covariance_.topLeftCorner(size(), size()); }

  /// Moves on by `dt` s: T <- T Exp(dt nu); xi and e pick up Ad(T) J_l(dt nu) dt dnu.
  void propagate(double dt, const ProcessNoise& noise);

  /// The process noise of the last `dt` s alone, beyond what propagate added: the mean stays where it is.
  void disturb(double dt, const ProcessNoise& noise);

  /// The body is at pose() * motion instead, and its pose less certain by `covariance`, 6x6 of independent
  /// errors (position, rotation) along the world axes; the landmarks stay where they are.
  void displace(const SE3& motion, const Matrix6d& covariance);

  /// Kalman update by a correction made from this state. With `cam_T_imu` landmarks before the camera are
  /// corrected in inverse depth (see retract). False, and no change, when it is not valid. Throws
  /// std::logic_error for a correction without H where inactive landmarks are kept.
  bool apply(Correction correction, const SE3* cam_T_imu = nullptr);

  /// Adds the landmark at `position` (world), seen from here with position noise covariance `noise` (3x3,
  /// world axes): e = xi_p + n.
  void addLandmark(FeatureId id, const Eigen::Vector3d& position, const Eigen::Matrix3d& noise);

  /// Marginalises a landmark; the last one takes its place.
  void removeLandmark(std::size_t index);

  /// Whether landmarks out of view can be kept; if so, they are in inactive().
  bool keepsInactive() const { return inactive_.has_value(); }
  const InactiveMap& inactive() const { return *inactive_; }
  /// As InactiveMap has it: changes no estimate, spreads the work over time.
  double compose(double operations) { return inactive_->compose(operations); }

  /// Makes a landmark an inactive one; the last one takes its place. No inactive landmark has its id. `slid`
  /// (3x3, m^2, world axes): what the point was displaced by its track, independent of all other errors.
  void deactivateLandmark(std::size_t index, const Eigen::Matrix3d& slid = Eigen::Matrix3d::Zero());

  /// Brings inactive landmarks back as the last active ones, in this order, anchored, after settling what was
  /// deferred. Throws std::out_of_range for an id that is not inactive.
  void activateLandmarks(const std::vector<FeatureId>& ids);

  /// See InactiveMap::marginaliseOldest and InactiveMap::estimates.
  std::vector<InactiveLandmark> marginaliseOldest(std::size_t count);
  std::vector<InactiveLandmark> inactiveLandmarks(InactiveMap::Covariances covariances) const;

  /// Landmarks, and the joint covariance (18 + 3k, square) of the errors along the world axes: (position,
  /// rotation) as in poseCovariance, dnu, db, and d of each landmark.
  struct Joint {
    std::vector<Landmark> landmarks;
    Eigen::MatrixXd covariance;
  };
  /// The inactive landmarks, the one longest out of view first, and the active ones at `active`, exactly.
  /// Settles what was deferred.
  Joint joint(const std::vector<std::size_t>& active);

  /// Everything anew: these means, and the landmarks of `joint` as inactive ones. The state keeps inactive
  /// landmarks.
  void restore(const SE3& pose, const Vector6d& twist, const Vector6d& bias, Joint joint);

  /// The inactive landmarks are these instead: `covariance` (3k x 3k, m^2) of their errors d, independent of
  /// the active errors.
  void adopt(std::vector<Landmark> landmarks, Eigen::MatrixXd covariance);

  /// Another world frame: pose and landmarks are at to_T_world of where they were, and the errors along its
  /// axes. Throws std::logic_error where landmarks are inactive.
  void moveWorld(const SE3& to_T_world);

  /// Adds a random motion of covariance `noise` (6x6 of (xi_p, xi_R)) of pose and landmarks together,
  /// rigidly, past those that are anchored or inactive. No measurement of landmarks that are not anchored
  /// sees it.
  void loosen(const Matrix6d& noise);

  void addObservations(std::size_t index, std::size_t count) { landmarks_[index].observations += count; }
  /// The landmark is tracked from now on, so that it drifts with what is in view (see Landmark::anchored);
  /// the vehicle has driven `driven` m.
  void beginTrack(std::size_t index, double driven) {
    landmarks_[index].anchored = false;
    landmarks_[index].tracked_since = driven;
  }

  /// Makes three consecutive rows of twist or bias, from `row` on, unknown again: no correlation, the given
  /// sigma.
  void forget(Eigen::Index row, const Eigen::Vector3d& sigma);

  /// 6x6 of (position, rotation) errors along the world axes as StateEstimate wants it: dp = xi_p - [p]x
  /// xi_R.
  Matrix6d poseCovariance() const;
  /// 3x3 of the landmark's position error along the world axes: e - [m]x xi_R.
  Eigen::Matrix3d landmarkCovariance(std::size_t index) const;
  /// 3x3 of its error relative to the body's position, e - xi_p, of the landmark whose rows begin at `row`.
  Eigen::Matrix3d relativeCovariance(Eigen::Index row) const;

 private:
  using Columns6 = Pooled<Eigen::Matrix<double, Eigen::Dynamic, 6>>;

  Columns6 twistInfluence(double dt, const SE3& start) const;
  void addSquare(const Columns6& G, const Matrix6d& noise);
  void addTwistNoise(const Columns6& G, double dt, const ProcessNoise& noise, const Columns6& cross_start,
                     const Matrix6d& twist_covariance);
  PooledVector<Eigen::Matrix3d> retract(const Pooled<Eigen::VectorXd>& error, const SE3* cam_T_imu);
  void transport(const PooledVector<Eigen::Matrix3d>& M);
  void record(DeferredStep step);
  void turnToWorldAxes(Eigen::Ref<Eigen::MatrixXd> rows) const;
  void dropLandmark(std::size_t index);
  void reserve(Eigen::Index size);

  SE3 pose_;
  Vector6d twist_ = Vector6d::Zero();
  Vector6d bias_ = Vector6d::Zero();
  PooledVector<Landmark> landmarks_;
  PooledMatrix covariance_; // capacity; the top left size() x size() is in use
  std::optional<InactiveMap> inactive_;
};

} // namespace vi_ekf_slam::invariant
