#!/usr/bin/env bash
# A real Blender window (Debian sid's package, 5.2) without a screen: debootstrap root, Xvfb, software OpenGL. Needs root.
#   window.sh setup               once, about 5 minutes and 4.5 GB
#   window.sh start [FILE.blend]  X server, window manager, Blender with harness.py
#   window.sh py [SECONDS]        runs Python from standard input inside the window's Blender, prints its output
#   window.sh click X Y [BUTTON] | drag X1 Y1 X2 | type TEXT | key KEYS...    pixels of a 1600x1000 screen
#   window.sh move X Y            the pointer, without a button
#   window.sh wheel X Y STEPS     turns the mouse wheel, downwards; upwards for negative STEPS
#   window.sh path X1 Y1 X2 Y2 ...   presses at the first position, moves over the others, releases at the last
#   window.sh drop X Y FILE...    drops files, as a file manager does
#   window.sh shot FILE.png       the whole screen
#   window.sh crash | again       kills Blender; starts it again
#   window.sh small FILE.png FILE.jpg | differ FILE.jpg FILE.jpg WxH+X+Y    of screenshots, 1200x750 pixels
#   window.sh stop                ends what start began
# BLENDER_WINDOW_SEES: folders, with colons between, that are visible inside at the same path (checkout, environments, the engine's Python).
set -eu
root=${BLENDER_WINDOW_ROOT:-${TMPDIR:-/tmp}/blender_window_root}   # the Debian root
work=${BLENDER_WINDOW_WORK:-${TMPDIR:-/tmp}/blender_window}        # commands, logs, home; same path inside
here=$(cd "$(dirname "$0")" && pwd)
export DISPLAY=${BLENDER_WINDOW_DISPLAY:-:77}   # two windows at once need two
inside() { chroot "$root" env DISPLAY=$DISPLAY HOME="$work/home" XDG_RUNTIME_DIR=/tmp LIBGL_ALWAYS_SOFTWARE=1 "$@"; }
# exec: the number of the background process is that of the program itself.
begin() { (exec chroot "$root" env DISPLAY=$DISPLAY HOME="$work/home" XDG_RUNTIME_DIR=/tmp LIBGL_ALWAYS_SOFTWARE=1 "$@") & echo $! >>"$work/pids"; }
# Folders are bound in a mount namespace of this window, which ends with its last process: several windows share a root.
runs() { [ "$(readlink "/proc/$1/root")" = "$(realpath "$root")" ]; }
if [ -z "${BLENDER_WINDOW_IS_PRIVATE:-}" ]; then
  export BLENDER_WINDOW_IS_PRIVATE=1
  first=$(head -1 "$work/pids" 2>/dev/null || true)
  if [ -n "$first" ] && runs "$first"; then exec nsenter --mount --target "$first" bash "$here/window.sh" "$@"; fi
  exec unshare --mount --propagation private bash "$here/window.sh" "$@"
fi
bind_all() { local IFS=:; for folder in /proc /dev "$work" ${BLENDER_WINDOW_SEES:-}; do bind "$folder"; done; }
bind() { mkdir -p "$root$1"; mountpoint -q "$root$1" || mount --bind "$1" "$root$1"; }
start_blender() { begin env WINDOW_WORK="$work" blender --gpu-backend opengl --window-geometry 0 0 1600 1000 "$@" --python "$work/harness.py" >>"$work/blender.log" 2>&1; }
# xdotool finds the names of F1 to F12 together with Alt, and presses both: F12 never rendered. By numbers it does not.
number_of() { case $1 in F[1-9] | F10) echo $((66 + ${1#F})) ;; F11 | F12) echo $((84 + ${1#F})) ;; *) echo "$1" ;; esac; }
mkdir -p "$work/commands" "$work/home"
# Before anything is bound: debootstrap makes /dev of the root itself, and must not find that of the computer there.
if [ "${1:-}" = setup ] && { [ ! -x "$root/usr/bin/apt-get" ] || [ -e "$root/debootstrap" ]; }; then
  mirror=$(cat /etc/apt/sources.list /etc/apt/sources.list.d/*.list /etc/apt/sources.list.d/*.sources 2>/dev/null |
    awk '/^deb /{print $2; exit} /^URIs:/{print $2; exit}')
  command -v debootstrap >/dev/null || { echo "debootstrap is missing; install it (Debian: apt-get install debootstrap)." >&2; exit 1; }
  [ ! -e "$root/debootstrap" ] || rm -rf --one-file-system "$root"   # of a set-up that was stopped
  debootstrap --variant=minbase --include=ca-certificates sid "$root" "$mirror"
fi
bind_all
case ${1:-} in
setup)
  cp /etc/resolv.conf "$root/etc/"; cp -n /etc/apt/apt.conf.d/* "$root/etc/apt/apt.conf.d/" 2>/dev/null || true
  # python3-cattr: without it Blender's extension system does not register
  chroot "$root" sh -c 'export DEBIAN_FRONTEND=noninteractive; apt-get update -q && apt-get install -y -q --no-install-recommends \
    blender xvfb xdotool imagemagick x11-utils libgl1-mesa-dri libglx-mesa0 libegl1 openbox dbus-x11 procps \
    python3-numpy python3-xlib python3-cattr python3-requests python3-zstandard python3-jsonschema' ;;
start)
  shift
  cp "$here/harness.py" "$work/"
  rm -f "$work/pids" "$root/tmp/.X${DISPLAY#:}-lock" "$root/tmp/.X11-unix/X${DISPLAY#:}"   # of a killed X server
  begin Xvfb $DISPLAY -screen 0 1600x1000x24 +extension GLX +render -noreset >"$work/xvfb.log" 2>&1
  sleep 2
  begin openbox >"$work/openbox.log" 2>&1
  start_blender "$@" ;;
again) start_blender ;;
py)
  name=$work/commands/$(date +%s%N); cat >"$name.part"; mv "$name.part" "$name.py"
  for _ in $(seq 1 $(( ${2:-30} * 10 ))); do [ -e "$name.out" ] && { cat "$name.out"; exit 0; }; sleep 0.1; done
  echo "no answer"; exit 1 ;;
# Blender wants to see the pointer arrive before it is pressed, and a press to last.
click) inside xdotool mousemove $(($2 - 6)) $(($3 - 3)) sleep 0.3 mousemove "$2" "$3" sleep 0.5 mousedown "${4:-1}" sleep 0.12 mouseup "${4:-1}" ;;
move) inside xdotool mousemove $(($2 - 6)) $(($3 - 3)) sleep 0.3 mousemove "$2" "$3" ;;
wheel) inside xdotool mousemove "$2" "$3" sleep 0.5 click --repeat "${4#-}" --delay 80 $(( $4 > 0 ? 5 : 4 )) ;;
drag)
  inside xdotool mousemove $(($2 - 4)) "$3" sleep 0.8 mousemove "$2" "$3" sleep 1.5 mousedown 1 sleep 0.8
  for i in 1 2 3 4 5 6; do inside xdotool mousemove $(($2 + ($4 - $2) * i / 6)) "$3" sleep 0.7; done
  inside xdotool mouseup 1 ;;
path)
  shift
  inside xdotool mousemove $(($1 - 4)) "$2" sleep 0.5 mousemove "$1" "$2" sleep 0.5 mousedown 1 sleep 0.3
  while [ $# -ge 2 ]; do inside xdotool mousemove "$1" "$2" sleep 0.4; shift 2; done
  inside xdotool mouseup 1 ;;
drop) shift; cp "$here/drop.py" "$work/"; inside python3 "$work/drop.py" "$@" ;;
type) inside xdotool key ctrl+a; sleep 0.2; inside xdotool type --delay 25 "$2"; sleep 0.3; inside xdotool key Return ;;
key)
  shift
  for key in "$@"; do inside xdotool key "$(number_of "$key")"; done ;;
small) inside convert "$2" -resize 1200x750 -quality 82 "$work/small.jpg" && cp "$work/small.jpg" "$3" ;;
differ)   # mean difference of a part of two pictures, 0 to 1
  cp "$2" "$work/one.jpg"; cp "$3" "$work/two.jpg"
  for name in one two; do inside convert "$work/$name.jpg" -crop "$4" +repage "$work/$name.png"; done
  inside compare -metric MAE "$work/one.png" "$work/two.png" null: 2>&1 | sed 's/.*(\(.*\)).*/\1/' || true ;;
shot) inside import -window root "$work/shot.png" && cp "$work/shot.png" "$2" ;;
crash) kill -9 "$(tail -1 "$work/pids")" ;;
stop)
  [ ! -e "$work/pids" ] || { tac "$work/pids" | while read -r pid; do ! runs "$pid" || kill "$pid" || true; done; rm "$work/pids"; sleep 5; } ;;
*) sed -n '2,15p' "$0"; exit 2 ;;
esac
