# Puts vsensed in its place on a robot's board; it runs there, as part of `vsense robot deploy`.
#
#     sh install.sh FOLDER auto|systemd|init|none [WORD]...
#
# FOLDER holds what was sent, and goes away. Words: "check" looks whether all is well before the new
# daemon starts; "force" does it in the midst of an experiment, too; "daemon" brings the daemon
# alone, to a board that has settings; "settings" brings the settings alone; "key" brings the robot's
# key alone, to a board that has one; "rollback" brings nothing, and goes back to the daemon before
# this one and its settings; the key stays what it is. Each file is replaced
# whole: a board whose power fails meanwhile has the old one or the new one. With VSENSED_ROOT set
# all paths begin there, as for an image of a board.
set -eu
from=$1 kind=$2 root=${VSENSED_ROOT:-}
shift 2
words=" $* "
trap 'rm -rf "$from"' EXIT
fail() { echo "$1" >&2; exit 1; }
told() { case $words in *" $1 "*) ;; *) return 1 ;; esac; }
[ "$(id -u)" -eq 0 ] || fail "needs root: log in as root, or give --sudo"
binary=/usr/local/bin/vsensed conf=/etc/vsensed.conf key=/etc/vsensed.key
radio=/usr/local/sbin/vsensed-radio
copy() { # copy FILE PLACE MODE
    mkdir -p "$(dirname "$root$2")"
    (umask 077 && cp "$1" "$root$2.new") # nobody else reads a key, not even for a moment
    chmod "$3" "$root$2.new"
    sync
    mv "$root$2.new" "$root$2"
}
put() { copy "$from/$1" "$2" "$3"; }
setting() { sed -n "s/^$1 *= *//p" "$2" 2>/dev/null || true; }

# A connection to the host's port is an experiment that has this robot.
experiment() {
    port=$(setting port "$root$conf")
    [ -n "$port" ] || return 1
    port=$(printf %04X "$port")
    grep -q "^ *[0-9]*: [0-9A-F]*:[0-9A-F]* [0-9A-F]*:$port 01 " "$root/proc/net/tcp" 2>/dev/null
}
# Where the journal has it: "2026-11-24T14:02:33+0100 ...: connected: 5 sensors".
since() {
    [ -d "$root/run/systemd/system" ] || return 0
    journalctl -u vsensed -n 1000 -o short-iso --no-pager 2>/dev/null |
        sed -n 's/^\([0-9-]*\)T\([0-9]*:[0-9]*\).*: connected: .*/ since \1 \2/p' | tail -n 1
}
if ! told force && experiment; then
    fail "robot $(setting tag "$root$conf") is in use by $(setting host "$root$conf")$(since):\
 end that run there, or give --force"
fi

if [ "$kind" = auto ]; then
    kind=init
    [ ! -d "$root/run/systemd/system" ] || kind=systemd
fi
service() { # service start|stop
    case $kind in
        systemd) systemctl "$1" vsensed ;;
        init) "$root/etc/init.d/vsensed" "$1" ;;
    esac
}
install_service() {
    case $kind in
        systemd)
            put vsensed.service /etc/systemd/system/vsensed.service 644
            systemctl daemon-reload
            systemctl -q enable vsensed
            ;;
        init)
            mkdir -p "$root/var/run" "$root/var/log"
            put vsensed.init /etc/init.d/vsensed 755
            if command -v update-rc.d >/dev/null; then
                update-rc.d vsensed defaults >/dev/null
            elif [ -e "$root/etc/init.d/rcS" ]; then # BusyBox starts all S* in order
                ln -sf vsensed "$root/etc/init.d/S90vsensed"
            fi
            ;;
    esac
}

# The same daemon again is no other one to go back to.
put_daemon() {
    if [ -f "$root$binary" ] && ! cmp -s "$root$binary" "$from/vsensed"; then
        copy "$root$binary" $binary.last 755
        [ ! -f "$root$conf" ] || copy "$root$conf" $conf.last 644
    fi
    put vsensed $binary 755
}

# NetworkManager sets a radio's power saving whenever it connects: 2 has it turned off.
put_radio() {
    put vsensed.radio $radio 755
    if [ -d "$root/etc/NetworkManager/conf.d" ]; then
        printf '[connection]\nwifi.powersave = 2\n' >"$from/powersave"
        put powersave /etc/NetworkManager/conf.d/vsensed-powersave.conf 644
    fi
}

# A driver's files lie beside each other; a driver in Python imports what lies beside it.
put_drivers() {
    for file in "$from"/drivers/*; do
        [ ! -f "$file" ] || put "drivers/${file##*/}" "/usr/local/lib/vsense/${file##*/}" 755
    done
}

# With a key comes who the robot is.
put_key() {
    [ ! -f "$from/vsensed.key" ] || put vsensed.key $key 600
}
# An id that was given to this robot stays its own.
keep_uid() {
    [ ! -f "$from/vsensed.key" ] || return 0
    uid=$(setting uid "$root$conf")
    if [ -n "$uid" ] && [ -z "$(setting uid "$from/vsensed.conf")" ]; then
        echo "uid = $uid" >>"$from/vsensed.conf"
    fi
}
# With settings that it refuses a daemon would end at every start.
try() { # try DAEMON SETTINGS
    said=$("$1" --identify --config "$2" 2>&1 >/dev/null) ||
        fail "its settings cannot be used: $(echo "$said" | sed 's/^[^ ]*: \([^ ]*:[0-9]*: \)*//')"
}
go_back() {
    [ -f "$root$binary.last" ] || fail "has no earlier daemon to go back to"
    for file in $binary $conf; do
        [ -f "$root$file.last" ] || continue
        cp "$root$file" "$from/now"
        copy "$root$file.last" $file "$([ $file = $binary ] && echo 755 || echo 644)"
        copy "$from/now" $file.last "$([ $file = $binary ] && echo 755 || echo 644)"
    done
}

if told rollback; then
    go_back
elif told key; then
    [ -n "$(setting key "$root$conf")" ] || fail "has no key yet: bring it one with vsense robot deploy"
    put_key
elif told settings; then
    put_key
    keep_uid
    try "$root$binary" "$from/vsensed.conf"
    put_drivers
    put vsensed.conf $conf 644
else
    chmod 755 "$from/vsensed"
    "$from/vsensed" --version >/dev/null || fail "this board cannot run it: built for another target?"
    if told daemon; then
        [ -f "$root$conf" ] || fail "has no settings yet: deploy to it once without --controller"
        try "$from/vsensed" "$root$conf"
        put_key # of a board that has a former one
        put_daemon
    else
        put_key
        keep_uid
        try "$from/vsensed" "$from/vsensed.conf"
        put_daemon
        put_drivers
        put vsensed.conf $conf 644
        put_radio
        install_service
    fi
fi
version=$("$root$binary" --version)
service stop
well=0
report=$("$root$binary" --identify --config "$root$conf" 2>/dev/null) && echo "uid: $report"
if told check; then
    "$root$binary" --check --config "$root$conf" || well=1
fi
service start
[ ! -f "$root$radio" ] || sh "$root$radio"
echo "$kind: $version"
exit $well
