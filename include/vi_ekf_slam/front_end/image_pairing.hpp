#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <opencv2/core.hpp>
#include <optional>

#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// An image that has come, and is decoded only if it is used.
struct PendingImage {
  Stamp stamp = 0;
  std::function<cv::Mat()> decode; ///< 8 bit, one channel; empty: it cannot be
};

struct PendingPair {
  PendingImage left, right;
};

/// Pairs left and right images by their stamps and holds each pair until the gyro has reported up to it. What
/// comes out depends on the stamps alone, not on the order in which left, right and gyro arrive, each in an
/// order of its own; and what has no partner is counted. (message_filters' synchronisers do neither.)
class ImagePairing {
 public:
  struct Options {
    /// s between the stamps of a pair, and no more than half of the time since the image before of either
    /// camera: else one that is lost would pair all that follow with their neighbours.
    double tolerance_s = 0.005;
    double max_wait_s =
        0.2; ///< s of sensor time that an image waits for its partner, and a pair for the gyro
  };

  struct Counts {
    std::uint64_t left_alone = 0, right_alone = 0; ///< no partner
    std::uint64_t without_stamp = 0;               ///< stamp 0: nobody has set it
    std::uint64_t disordered = 0;                  ///< not later than the one before of its camera
    std::uint64_t without_gyro = 0;                ///< pairs that waited for it in vain
    std::uint64_t shed = 0;                        ///< pairs given up for newer ones, or as time was set back
  };

  explicit ImagePairing(const Options& options) : options_(options) {}

  void addLeft(PendingImage image) { add(std::move(image), left_); }
  void addRight(PendingImage image) { add(std::move(image), right_); }
  /// A gyro sample has come that will be in what tracks are predicted with.
  void noteGyro(Stamp stamp);
  /// false: no pair waits for the gyro, since there is none.
  void expectGyro(bool expected) { gyro_expected_ = expected; }
  /// true: something else is missing, for which pairs wait as long.
  void hold(bool is_held) { is_held_ = is_held; }

  /// The next pair in the order of stamps; nothing where none is complete.
  std::optional<PendingPair> pop();
  /// The newest complete pair; the others before it are shed.
  std::optional<PendingPair> popNewest();
  /// The data are over: nothing waits any longer.
  void close() { is_closed_ = true; }

  const Counts& counts() const { return counts_; }

 private:
  struct Waiting {
    PendingImage image;
    double since; ///< s, after the image before of its camera
  };
  struct Camera {
    std::deque<Waiting> waiting;
    std::optional<Stamp> last; ///< of the newest image that came
    std::uint64_t Counts::*alone;
  };

  void add(PendingImage image, Camera& camera);
  void dropOldest(Camera& camera);
  void pairUp();
  bool lacksSomething(const PendingPair& pair) const;
  bool isReady(const PendingPair& pair);

  Options options_;
  Camera left_{{}, {}, &Counts::left_alone}, right_{{}, {}, &Counts::right_alone};
  std::deque<PendingPair> pairs_;
  std::optional<Stamp> gyro_; ///< newest
  Stamp newest_ = 0;          ///< of any image
  bool gyro_expected_ = true;
  bool is_held_ = false;
  bool is_closed_ = false;
  Counts counts_;
};

} // namespace vi_ekf_slam
