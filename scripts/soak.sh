#!/usr/bin/env bash
# Drives for FRAMES frames of 10 Hz (default 864000, a day) through the node's own input path in one process, as fast as it
# goes: scripts/soak.sh [FRAMES]. A line each hour of sensor time; exits with 1 when memory grows by more than 5 % after
# the second hour, a number is none, or a pose is missing. The results stay in build/soak/.

set -euo pipefail
exec </dev/null
# shellcheck source=scripts/environment.sh
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"
"$root/scripts/setup.sh"
mkdir -p "$build/soak"
exec "$build/devel/lib/vi_ekf_slam/soak" --frames "${1:-864000}" --output "$build/soak"
