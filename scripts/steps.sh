# Sourced by the scripts of the set-up: `step WORDS COMMAND ARGUMENT..` runs a command and says in one line how
# long it took. What the command prints is shown only where it fails.

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
