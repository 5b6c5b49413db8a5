function du = solve_alssnn(phi, seen, dv, scale)
% Return the one du with phi(seen, du) = dv, in at most 200 steps of Newton's method.
% A step must halve the least that was lacking so far, or lead down and not far past
% the lowest point of its line, in at most 30 trials.
du = zeros(size(dv));
q = du;
[e, J, rounding] = lacking(phi, seen, dv, scale, q);
least = e.' * e;
for n = 1:200
    if ~isfinite(least), break; end
    step = J \ e;
    if all(abs(e) <= rounding | abs(step) <= 4 * eps * (1 + abs(q)))
        q = q - step;
        break
    end
    down = e.' * step;
    low = 0; high = 1; share = 1; found = false;
    for m = 1:30
        next = q - share * step;
        [e, J, rounding] = lacking(phi, seen, dv, scale, next);
        ahead = e.' * step;
        if e.' * e < least / 4
            least = e.' * e;
            found = true;
        elseif ahead >= 0 && (share >= 1 || ahead <= down / 2)
            found = true;
        elseif ahead < 0
            high = share;
        else
            low = share;
        end
        if found, break; end
        share = (low + high) / 2;
    end
    if ~found, break; end  % rounding
    q = next;
end
du = scale .* q;
end

function [e, J, rounding] = lacking(phi, seen, dv, scale, q)
% Return phi - dv and its derivative by q = du, all in sizes of u.
[z, J, extent] = channels(phi, [seen; scale .* q]);
e = (z - dv) ./ scale;
J = diag(1 ./ scale) * J(:, numel(seen) + 1:end) * diag(scale);
rounding = 4 * eps * (extent + abs(dv)) ./ scale;
end
