# Puts vsensed in its place on a robot's board; it runs there, as part of `vsense robot deploy`.
#
#     sh install.sh FOLDER auto|systemd|init|none check|-
#
# FOLDER holds what was sent, and goes away. "check" looks whether all is well before the new
# daemon starts. Each file is replaced whole: a board whose power fails meanwhile has the old one
# or the new one. With VSENSED_ROOT set all paths begin there, as for an image of a board.
set -eu
from=$1 kind=$2 check=$3 root=${VSENSED_ROOT:-}
trap 'rm -rf "$from"' EXIT
fail() { echo "$1" >&2; exit 1; }
[ "$(id -u)" -eq 0 ] || fail "needs root: log in as root, or give --sudo"
chmod 755 "$from/vsensed"
version=$("$from/vsensed" --version) || fail "this board cannot run it: built for another target?"
put() { # put FILE PLACE MODE
    mkdir -p "$(dirname "$root$2")"
    cp "$from/$1" "$root$2.new"
    chmod "$3" "$root$2.new"
    sync
    mv "$root$2.new" "$root$2"
}
if [ "$kind" = auto ]; then
    kind=init
    [ ! -d "$root/run/systemd/system" ] || kind=systemd
fi
put vsensed /usr/local/bin/vsensed 755
put vsensed.conf /etc/vsensed.conf 644
case $kind in
    systemd)
        put vsensed.service /etc/systemd/system/vsensed.service 644
        systemctl daemon-reload
        systemctl -q enable vsensed
        systemctl stop vsensed
        ;;
    init)
        mkdir -p "$root/var/run" "$root/var/log"
        put vsensed.init /etc/init.d/vsensed 755
        if command -v update-rc.d >/dev/null; then
            update-rc.d vsensed defaults >/dev/null
        elif [ -e "$root/etc/init.d/rcS" ]; then # BusyBox starts all S* in order
            ln -sf vsensed "$root/etc/init.d/S90vsensed"
        fi
        "$root/etc/init.d/vsensed" stop
        ;;
esac
well=0
if [ "$check" = check ]; then
    "$root/usr/local/bin/vsensed" --check --config "$root/etc/vsensed.conf" || well=1
fi
case $kind in
    systemd) systemctl start vsensed ;;
    init) "$root/etc/init.d/vsensed" start ;;
esac
echo "$kind: $version"
exit $well
