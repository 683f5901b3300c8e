# A session of HAL in folders and namespaces of its own, as an unprivileged user: as root LinuxCNC loads nothing.
#     unshare --mount --ipc --pid --fork --mount-proc sh session.sh MODULES PLACE
# PLACE has setup.hal and, for its streamer, nominal.txt and functions.hal, carried out when the streamer has begun. Each line of the standard input is a command for halcmd, or for the shell after a
# `!`; a line with a dot ends each answer. The first answer is that of the setup.
set -u
if [ "$(id -u)" = 0 ]; then
    mount --bind "$1" /usr/lib/linuxcnc/modules
    cd "$2" || exit 1
    # RUNTESTS: without it nothing is said where there is no terminal.
    exec setpriv --reuid=65534 --regid=65534 --clear-groups \
        env -i HOME="$2" PATH=/usr/bin:/bin RUNTESTS=1 HAL_RTMOD_DIR=/usr/lib/linuxcnc/modules sh "$0"
fi
/usr/lib/linuxcnc/realtime start
if halcmd -f setup.hal; then
    if [ -e nominal.txt ]; then
        halstreamer nominal.txt &
        halsampler -t record.txt &
        tries=0
        while [ "$(halcmd getp streamer.0.pin.0)" = 0 ] && [ $tries -lt 2000 ]; do
            sleep 0.01
            tries=$((tries + 1))
        done
        halcmd -f functions.hal
    fi
    echo ready
fi
echo .
while read -r line; do
    case $line in
    !*) eval "${line#!}" ;;
    *) halcmd $line ;;
    esac
    echo .
done
halcmd stop
halcmd unload all
/usr/lib/linuxcnc/realtime stop
