// What a node starts with, and what becomes of what an earlier one left.
#include "vi_ekf_slam/ros/node/map_store.hpp"

#include <filesystem>
#include <fstream>
#include <iterator>

#include "folder.hpp"
#include "vi_ekf_slam/ros/map_file.hpp"

namespace vi_ekf_slam {
namespace {

namespace fs = std::filesystem;

class MapStoreFolder : public InFolder {
 protected:
  void SetUp() override {
    InFolder::SetUp();
    map_.stamp = fromSeconds(1000.0);
    map_.variables = {{"twist", Vector6d::Zero()}, {"twist_bias", Vector6d::Zero()}};
    map_.covariance = Eigen::MatrixXd::Identity(18, 18);
  }

  void put(const std::string& name, const std::string& text) const {
    fs::create_directories(fs::path(at(name)).parent_path());
    std::ofstream(at(name)) << text;
  }
  std::string get(const std::string& name) const {
    std::ifstream file(at(name));
    return {std::istreambuf_iterator<char>(file), {}};
  }
  MapUse begin(const MapStore::Settings& settings) const {
    SlamSystem system({});
    MapStore(settings).begin(system);
    return system.estimator().mapUse();
  }
  MapStore::Settings resuming() const { return {directory_, "", true, "map"}; }

  SavedMap map_;
};

TEST_F(MapStoreFolder, ResumesAndKeepsWhatWasThere) {
  writeMapFile(at("map.bag"), map_, "map");
  put("trajectory.tum", "first");
  put("before_reset_1/trajectory.tum", "zeroth");
  put("notes.txt", "mine");
  EXPECT_EQ(begin(resuming()), MapUse::kWaiting) << "until the first measurement says how long ago it was";
  EXPECT_EQ(get("before_resume_1/trajectory.tum"), "first");
  EXPECT_EQ(get("before_resume_1/before_reset_1/trajectory.tum"), "zeroth");
  EXPECT_EQ(get("before_resume_1/map.bag"), get("map.bag"));
  EXPECT_FALSE(fs::exists(at("trajectory.tum")));
  EXPECT_EQ(get("notes.txt"), "mine");

  begin(resuming());
  EXPECT_FALSE(fs::exists(at("before_resume_2"))) << "killed before it had left anything";
  put("trajectory.tum", "second");
  const std::string old = get("map.bag");
  map_.variables[0].mean[0] = 1.0;
  MapStore store(resuming());
  store.write([this] { return map_; }, store.savedPath());
  EXPECT_EQ(get("before_resume_1/map.bag"), old) << "it is not written over";
  begin(resuming());
  EXPECT_EQ(get("before_resume_2/trajectory.tum"), "second");
  EXPECT_EQ(get("before_resume_2/map.bag"), get("map.bag"));
}

TEST_F(MapStoreFolder, SetsABrokenMapAsideAndStarts) {
  put("map_broken_1.bag", "an older one");
  put("map.bag", "broken");
  EXPECT_EQ(begin(resuming()), MapUse::kNone);
  EXPECT_FALSE(fs::exists(at("map.bag")));
  EXPECT_EQ(get("map_broken_1.bag"), "an older one");
  EXPECT_EQ(get("map_broken_2.bag"), "broken");
  EXPECT_EQ(begin(resuming()), MapUse::kNone);
}

TEST_F(MapStoreFolder, LooksForThePlaceInAMapOfAnotherMotionModel) {
  map_.variables = {{"velocity", Eigen::Vector3d::Zero()}, {"gyro_bias", Eigen::Vector3d::Zero()}};
  map_.covariance = Eigen::MatrixXd::Identity(12, 12);
  writeMapFile(at("map.bag"), map_, "map");
  SlamSystem system({});
  MapStore(resuming()).begin(system);
  const Stamp soon = map_.stamp + fromSeconds(0.1); // as resuming would need it
  system.add(ImuSample{soon, Eigen::Vector3d::Zero(), {}});
  system.flush();
  EXPECT_EQ(system.estimator().mapUse(), MapUse::kWaiting);
  EXPECT_TRUE(fs::exists(at("map.bag"))) << "it is not broken";
  try {
    system.resumeFrom(std::make_shared<const SavedMap>(map_), "FILE");
    ADD_FAILURE() << "resumed";
  } catch (const MapError& e) {
    EXPECT_EQ(std::string(e.what()).rfind("FILE: variable twist is missing", 0), 0U) << e.what();
  }
}

TEST_F(MapStoreFolder, StartsWithTheMapFileOrNotAtAll) {
  const MapStore::Settings settings{"", at("other.bag"), false, "map"};
  EXPECT_THROW(begin(settings), MapError);
  writeMapFile(at("other.bag"), map_, "map");
  EXPECT_EQ(begin(settings), MapUse::kWaiting);
  Config config;
  config.invariant.map.keep = MapKeep::kNone;
  SlamSystem system(config);
  EXPECT_THROW(MapStore(settings).begin(system), MapError) << "that estimator has no use for it";
}

TEST_F(MapStoreFolder, SavesNotOverTheMapThatItWaitsToFind) {
  writeMapFile(at("map.bag"), map_, "map");
  for (const bool resume : {false, true}) {
    SlamSystem system({});
    MapStore store({directory_, "", resume, "map"});
    system.loadMap(store.load({}), store.source());
    store.noteLoaded(store.source());
    system.add(ImuSample{fromSeconds(2000.0), Eigen::Vector3d::Zero(), {}});
    system.flush();
    EXPECT_EQ(static_cast<bool>(store.snapshot(system.estimator(), store.savedPath())), resume)
        << "a copy is in before_resume_N";
    const std::string folder = fs::path(directory_).filename().string();
    for (const std::string& same : {at("./map.bag"), at("../" + folder + "/map.bag")})
      EXPECT_EQ(static_cast<bool>(store.snapshot(system.estimator(), same)), resume) << same;
    EXPECT_TRUE(store.snapshot(system.estimator(), at("other.bag")));
    EXPECT_EQ(store.keepsSaved(), resume);
  }
  EXPECT_THROW(MapStore({"", "", false, "map"}).load({}), MapError);
}

TEST_F(MapStoreFolder, ExemptsFromThatOnlyTheMapThatItKeepsACopyOf) {
  writeMapFile(at("site.bag"), map_, "map");
  SlamSystem system({});
  MapStore store(resuming());
  store.begin(system);
  store.noteLoaded(at("site.bag"));
  system.loadMap(store.load(at("site.bag")), at("site.bag"));
  system.add(ImuSample{fromSeconds(2000.0), Eigen::Vector3d::Zero(), {}});
  system.flush();
  EXPECT_FALSE(store.snapshot(system.estimator(), at("site.bag")));
  EXPECT_TRUE(store.snapshot(system.estimator(), store.savedPath()));

  writeMapFile(at("map.bag"), map_, "map");
  store.noteLoaded(store.savedPath());
  EXPECT_TRUE(store.snapshot(system.estimator(), store.savedPath()));
  EXPECT_EQ(get("before_resume_1/map.bag"), get("map.bag"));
}

TEST_F(MapStoreFolder, LooksForTheMapItResumedFromAfterAReset) {
  map_.covariance *= 1e-4; // the heading is known
  writeMapFile(at("map.bag"), map_, "map");
  SlamSystem system({});
  MapStore(resuming()).begin(system);
  system.add(ImuSample{map_.stamp + fromSeconds(0.1), Eigen::Vector3d::Zero(), {}});
  system.flush();
  ASSERT_EQ(system.estimator().mapUse(), MapUse::kResumed);
  system.reset("asked for");
  EXPECT_EQ(system.estimator().mapUse(), MapUse::kWaiting);
}

} // namespace
} // namespace vi_ekf_slam
