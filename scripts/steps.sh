# Sourced by the set-up scripts: `step WORDS COMMAND ARGUMENT..` runs a command and prints its
# duration in one line. The command's output is shown only if it fails.

step() {
    local words=$1 began=${EPOCHREALTIME/[.,]/} output status=0
    shift
    printf '  %-50s' "$words"
    output=$(mktemp)
    "$@" >"$output" 2>&1 </dev/null || status=$?
    local tenths=$(((${EPOCHREALTIME/[.,]/} - began + 50000) / 100000))
    if [ "$status" -eq 0 ]; then
        printf '%4d.%d s\n' $((tenths / 10)) $((tenths % 10))
    else
        printf 'failed\n'
        cat "$output" >&2
    fi
    rm -f "$output"
    return "$status"
}
