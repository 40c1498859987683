#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Shell completions know the options of every command and action: those that its --help lists, no more and no less.
source "$(dirname "$0")/lib.sh"
source "$root/data/completions/brace.bash"
compopt() { :; }

options_of() { "$brace" "$@" --help | sed -nE 's/^ +(-., )?(--[a-z0-9-]+).*/\2/p' | sort -u; }

bash_offers() { # COMMAND [ACTION]
    COMP_WORDS=(brace "$@" --)
    COMP_CWORD=$(($# + 1))
    _brace
    printf '%s\n' "${COMPREPLY[@]}" | sort -u
}

# What stands in the part of a command in zsh's file; of an action, in its line there.
zsh_part() { awk -v c="        $1)" 'index($0, c) == 1 { on = 1 } on { print } on && /^            ;;$/ { exit }
    on && /;;$/ && /^        [a-z]/ { exit }' "$root/data/completions/_brace"; }

for command in restore info analyze metrics simulate train eval model 'dataset build' 'dataset pack' 'dataset verify' \
    'dataset info' 'dataset import' 'capture list' 'capture plan' 'capture run' 'capture check'; do
    set -- $command
    is "options that bash offers of $command" "$(bash_offers "$@")" "$(options_of "$@")"
    part=$(zsh_part "$1")
    [[ $part != *'$common'* ]] || part+=$(awk '/common=\(/ { on = 1 } on { print } on && /^    \)/ { exit }' "$root/data/completions/_brace")
    for option in $(options_of "$@"); do
        ok "zsh's $option of $command" grep -qE -- "$option([^a-z-]|\$)" <<<"$part"
    done
done
for action in sim conv model; do # one list for all
    for option in $(options_of bench $action); do
        ok "bash's $option of bench $action" grep -qx -- "$option" <<<"$(bash_offers bench $action)"
        ok "zsh's $option of bench $action" grep -qE -- "$option([^a-z-]|\$)" <<<"$(zsh_part bench)"
    done
done
finish
