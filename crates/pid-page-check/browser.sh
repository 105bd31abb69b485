#!/usr/bin/env bash
# Looks at pages in headless Chromium: nothing is cut at the widths of a phone, a tablet and a desk, nor in print.
# Without Chromium it says so and passes; .ci/run counts the line.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
browser=$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)
if [ -z "$browser" ]; then
    echo "pages not looked at: there is no chromium"
    if [ -n "${PID_SKIPPED:-}" ]; then
        echo "pages browser: there is no chromium" >>"$PID_SKIPPED"
    fi
    exit 0
fi
profile=$(mktemp -d)
trap 'rm -rf "$profile"' EXIT
bad=0
for page in "$@"; do
    result=$("$browser" --headless --no-sandbox --disable-gpu --hide-scrollbars --user-data-dir="$profile" \
        --allow-file-access-from-files --virtual-time-budget=20000 --dump-dom \
        "file://$here/browser.html?file://$(realpath "$page")" 2>/dev/null)
    if grep -q 'id="result">in order<' <<<"$result"; then
        echo "$page: in order"
    else
        bad=1
        echo "$page:"
        sed -n 's/.*id="result">//; s/<[^>]*>//g; /[^ ]/p' <<<"$result" | tail -n 40
    fi
done
exit $bad
