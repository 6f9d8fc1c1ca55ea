#!/bin/sh
# Records again what ARGoS's Lua controllers read and set: record.sh ARGOS PLUGIN CORE_PLUGIN
# ARGOS: where ARGoS 3 is installed, with Lua. PLUGIN: the library of argos3-epuck; CORE_PLUGIN: that
# of ARGoS's own e-puck; both are called libargos3plugin_simulator_epuck.so.
set -e
argos=$1 here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
cd "$work"
cp "$here"/compare.lua "$here"/*.argos .
c++ -O2 -std=c++17 -fPIC -shared -I"$argos/include" $(pkg-config --cflags lua5.3) "$here/floor.cpp" \
    -o libfloor.so
mkdir out plugins
for kind in own any foot pi; do
    ln -sf "$argos"/lib/argos3/*.so plugins/
    [ "$kind" = any ] && plugin=$3 || plugin=$2
    ln -sf "$plugin" plugins/libargos3plugin_simulator_epuck.so
    ARGOS_PLUGIN_PATH="$work/plugins:$work" LD_LIBRARY_PATH="$work/plugins" \
        "$argos/bin/argos3" -z -c "$kind.argos"
done
cp out/*.txt "$here"
rm -r "$work"
