-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;

-- Purpose:  AXI4-Lite slave: turns reads and writes of the bus into accesses, one after the other.
-- Generics: ADDRESS_BITS of a byte address; the lower two are ignored.
-- Timing:   An access stands on request_o until ready_i answers it, in the same clock or later. If it is answered in the
--           same clock, a read or write takes three clocks, from the first one with VALID to that of the response, and
--           one more if it waits for an access of the other kind. Ports have the names of the bus, for tools that know
--           it. aresetn forgets accesses of the bus and nothing else.

entity pe_axi_lite is
  generic (
    ADDRESS_BITS : positive -- byte address
  );
  port (
    aclk          : in    std_ulogic;                                   -- clock
    aresetn       : in    std_ulogic := '1';                            -- 0 forgets accesses
    s_axi_awaddr  : in    std_ulogic_vector(ADDRESS_BITS - 1 downto 0); -- write address
    s_axi_awvalid : in    std_ulogic;                                   -- there is one
    s_axi_awready : out   std_ulogic;                                   -- it is taken
    s_axi_wdata   : in    std_ulogic_vector(31 downto 0);               -- write data
    s_axi_wstrb   : in    std_ulogic_vector(3 downto 0);                -- bytes of it that count
    s_axi_wvalid  : in    std_ulogic;                                   -- there is some
    s_axi_wready  : out   std_ulogic;                                   -- it is taken
    s_axi_bresp   : out   std_ulogic_vector(1 downto 0);                -- answer to a write: OKAY or SLVERR
    s_axi_bvalid  : out   std_ulogic;                                   -- there is one
    s_axi_bready  : in    std_ulogic;                                   -- it is taken
    s_axi_araddr  : in    std_ulogic_vector(ADDRESS_BITS - 1 downto 0); -- read address
    s_axi_arvalid : in    std_ulogic;                                   -- there is one
    s_axi_arready : out   std_ulogic;                                   -- it is taken
    s_axi_rdata   : out   std_ulogic_vector(31 downto 0);               -- data that was read
    s_axi_rresp   : out   std_ulogic_vector(1 downto 0);                -- OKAY or SLVERR
    s_axi_rvalid  : out   std_ulogic;                                   -- there is some
    s_axi_rready  : in    std_ulogic;                                   -- it is taken
    request_o     : out   std_ulogic;                                   -- an access
    write_o       : out   std_ulogic;                                   -- it writes
    address_o     : out   std_ulogic_vector(ADDRESS_BITS - 1 downto 2); -- word that it reads or writes
    next_o        : out   std_ulogic_vector(ADDRESS_BITS - 1 downto 2); -- word that a read of the next clock reads
    data_o        : out   std_ulogic_vector(31 downto 0);               -- data to write
    strobe_o      : out   std_ulogic_vector(3 downto 0);                -- bytes of it that count
    ready_i       : in    std_ulogic;                                   -- the access is done
    data_i        : in    std_ulogic_vector(31 downto 0);               -- data that was read
    error_i       : in    std_ulogic                                    -- it cannot be done and had no effect
  );
end entity pe_axi_lite;

architecture rtl of pe_axi_lite is

  constant OKAY : std_ulogic_vector(1 downto 0) := "00";

  signal write_address : std_ulogic_vector(ADDRESS_BITS - 1 downto 2) := (others => '0');
  signal read_address  : std_ulogic_vector(ADDRESS_BITS - 1 downto 2) := (others => '0');
  signal write_data    : std_ulogic_vector(31 downto 0)               := (others => '0');
  signal strobe        : std_ulogic_vector(3 downto 0)                := (others => '0');
  signal read_data     : std_ulogic_vector(31 downto 0)               := (others => '0');
  signal write_answer  : std_ulogic_vector(1 downto 0)                := OKAY;
  signal read_answer   : std_ulogic_vector(1 downto 0)                := OKAY;

  -- What has been taken, and answered
  signal has_write_address : std_ulogic := '0';
  signal has_write_data    : std_ulogic := '0';
  signal has_read_address  : std_ulogic := '0';
  signal write_answered    : std_ulogic := '0';
  signal read_answered     : std_ulogic := '0';

  -- The access that stands
  signal write_waits : std_ulogic;
  signal read_waits  : std_ulogic;
  signal writing     : std_ulogic;
  signal reading     : std_ulogic;
  signal begun       : std_ulogic := '0'; -- in an earlier clock
  signal wrote       : std_ulogic := '0'; -- the access before was a write

begin

  write_waits <= has_write_address and has_write_data and not write_answered;
  read_waits  <= has_read_address and not read_answered;

  -- An access that has begun is finished; else they take turns.
  writing <= write_waits and (not read_waits or not wrote) when begun = '0' else
             wrote;
  reading <= read_waits and (not write_waits or wrote) when begun = '0' else
             not wrote;

  p_bus : process (aclk) is
  begin

    if rising_edge(aclk) then
      if (s_axi_awvalid = '1' and has_write_address = '0') then
        write_address     <= s_axi_awaddr(ADDRESS_BITS - 1 downto 2);
        has_write_address <= '1';
      end if;

      if (s_axi_wvalid = '1' and has_write_data = '0') then
        write_data     <= s_axi_wdata;
        strobe         <= s_axi_wstrb;
        has_write_data <= '1';
      end if;

      if (s_axi_arvalid = '1' and has_read_address = '0') then
        read_address     <= s_axi_araddr(ADDRESS_BITS - 1 downto 2);
        has_read_address <= '1';
      end if;

      if (s_axi_bready = '1') then
        write_answered <= '0';
      end if;

      if (s_axi_rready = '1') then
        read_answered <= '0';
      end if;

      if (writing = '1' or reading = '1') then
        begun <= not ready_i;
        wrote <= writing;
      end if;

      if (writing = '1' and ready_i = '1') then
        write_answer      <= error_i & '0';
        write_answered    <= '1';
        has_write_address <= '0';
        has_write_data    <= '0';
      end if;

      if (reading = '1' and ready_i = '1') then
        read_data        <= data_i;
        read_answer      <= error_i & '0';
        read_answered    <= '1';
        has_read_address <= '0';
      end if;

      if (aresetn = '0') then
        has_write_address <= '0';
        has_write_data    <= '0';
        has_read_address  <= '0';
        write_answered    <= '0';
        read_answered     <= '0';
        begun             <= '0';
      end if;
    end if;

  end process p_bus;

  request_o <= writing or reading;
  write_o   <= writing;
  address_o <= write_address when writing = '1' else
               read_address;
  next_o    <= read_address when has_read_address = '1' else
               s_axi_araddr(ADDRESS_BITS - 1 downto 2);
  data_o    <= write_data;
  strobe_o  <= strobe;

  s_axi_awready <= not has_write_address;
  s_axi_wready  <= not has_write_data;
  s_axi_bresp   <= write_answer;
  s_axi_bvalid  <= write_answered;
  s_axi_arready <= not has_read_address;
  s_axi_rdata   <= read_data;
  s_axi_rresp   <= read_answer;
  s_axi_rvalid  <= read_answered;

end architecture rtl;
